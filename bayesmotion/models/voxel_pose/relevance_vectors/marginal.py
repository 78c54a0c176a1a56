"""The marginal likelihood of the multivariate relevance vector machine, and its parts.

Outputs y_m = Phi w_m + noise of precision beta_m, weights w_mb ~ N(0, 1 / alpha_b) with
precisions that all outputs share. With the weights integrated out the log density of the
outputs depends on one alpha_i through each output's sparsity s and quality q,

    l(alpha_i) = 1/2 sum_m [ln alpha_i - ln(alpha_i + s_im) + q_im^2 / (alpha_i + s_im)]

(zero at infinity, where the basis is left out). `fast` climbs it one basis at a time. Rows
that are missing in an output are left out of its Phi.
"""

import numpy as np
from jaxtyping import Float
from scipy.linalg import lapack

NEWTON = 8


def log_marginal(
    phi: Float[np.ndarray, "n a"],
    y: Float[np.ndarray, "n m"],
    alpha: Float[np.ndarray, " a"],
    beta: Float[np.ndarray, " m"],
) -> float:
    """Return the log density of y, NaN where missing, with the weights integrated out."""
    total = 0.0
    for seen, own in patterns(y):
        rows = phi[seen]
        gram = rows.T @ rows
        for m in own:
            mean, _, log_det = posterior(gram, rows.T @ y[seen, m], alpha, float(beta[m]))
            residual = y[seen, m] - rows @ mean
            fit = beta[m] * residual @ residual + alpha @ mean**2
            count = len(residual) * np.log(beta[m] / (2 * np.pi))
            total += count + np.log(alpha).sum() - log_det - fit
    return 0.5 * float(total)


def patterns(y: np.ndarray) -> list[tuple[slice | np.ndarray, np.ndarray]]:
    """Return the rows that are seen together, and in which outputs they are."""
    missing = np.isnan(y)
    if not missing.any():
        return [(slice(None), np.arange(y.shape[1]))]
    found, which = np.unique(missing.T, axis=0, return_inverse=True)
    return [(np.flatnonzero(~one), np.flatnonzero(which == p)) for p, one in enumerate(found)]


def posterior(
    gram: np.ndarray, products: np.ndarray, alpha: np.ndarray, beta: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return mean and covariance of an output's weights, and the log determinant of its inverse.

    Of several outputs with one noise if `products` has as many columns.
    """
    # In units of the prior's sd the matrix has no eigenvalue below one.
    scale = 1.0 / np.sqrt(alpha)
    inner = np.eye(len(alpha)) + beta * scale[:, None] * gram * scale
    L = np.linalg.cholesky(inner)
    half, _ = lapack.dpotri(L, lower=1)  # pyright: ignore[reportAttributeAccessIssue]  compiled
    covariance = np.tril(half) + np.tril(half, -1).T
    covariance *= scale[:, None] * scale
    log_det = 2.0 * np.log(np.diag(L)).sum() + np.log(alpha).sum()
    return beta * covariance @ products, covariance, float(log_det)


def noise_precisions(
    phi: np.ndarray, y: np.ndarray, alpha: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    """Return the noise precisions where the marginal likelihood's derivative is zero."""
    determined = len(alpha) - np.einsum("maa,a->m", covariance, alpha)
    count = (~np.isnan(y)).sum(axis=0)
    residual = np.nansum((y - phi @ mean.T) ** 2, axis=0)
    floor = 1e-8 * count * np.nanvar(y, axis=0)
    return np.maximum(count - determined, 1e-3) / np.maximum(residual, floor)


def gain_at(alpha: np.ndarray, s: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return l(alpha) for each basis: s and q are (M, B)."""
    total = np.log(alpha) - np.log(alpha + s) + q**2 / (alpha + s)
    return 0.5 * total.sum(axis=0)


def best_alpha(s: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each basis' best finite precision and its l, which is not above zero if there is none.

    Begins at the maximum for equal s, which is exact for one output.
    """
    level, square = s.mean(axis=0), (q**2).mean(axis=0)
    low, high = 1e-8 * level, 1e8 * level
    alpha = level**2 / np.maximum(square - level, 1e-8 * level)
    alpha = np.clip(alpha, low, high)
    if len(s) > 1:
        for _ in range(NEWTON):
            below = 1.0 / (alpha + s)
            # First and second derivative of 2 l with respect to ln alpha.
            slope = (s * below - alpha * (q * below) ** 2).sum(axis=0)
            bend = -(alpha * s * below**2 + alpha * (q * below) ** 2 * (1 - 2 * alpha * below))
            bend = bend.sum(axis=0)
            # Uphill where it is not concave.
            step = np.where(bend < 0, -slope / np.minimum(bend, -1e-12), np.sign(slope))
            alpha = np.clip(alpha * np.exp(np.clip(step, -2.0, 2.0)), low, high)
    height = gain_at(alpha, s, q)
    # At the upper end the basis does nothing.
    return alpha, np.where(alpha < 0.99 * high, height, 0.0)
