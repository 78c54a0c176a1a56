"""The marginal likelihood of the multivariate relevance vector machine, and its parts.

Outputs y_m = Phi w_m + noise of precision beta_m, weights w_mb ~ N(0, 1 / alpha_b) with
precisions that all outputs share. With the weights integrated out the log density of the
outputs depends on one alpha_i through each output's sparsity s and quality q,

    l(alpha_i) = 1/2 sum_m [ln alpha_i - ln(alpha_i + s_im) + q_im^2 / (alpha_i + s_im)]

(zero at infinity, where the basis is left out). `relevance_fast` climbs it one basis at a
time; `expectation_maximisation` climbs it slowly, with all bases at once: the two are held
against each other in the tests.
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
    """Give the log density of y with the weights integrated out."""
    gram, products = phi.T @ phi, phi.T @ y
    total = 0.0
    for m, one in enumerate(beta):
        mean, _, log_det = posterior(gram, products[:, m], alpha, one)
        residual = y[:, m] - phi @ mean
        fit = one * residual @ residual + alpha @ mean**2
        total += len(y) * np.log(one / (2 * np.pi)) + np.log(alpha).sum() - log_det - fit
    return 0.5 * float(total)


def posterior(
    gram: np.ndarray, products: np.ndarray, alpha: np.ndarray, beta: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Give mean and covariance of an output's weights, and the log determinant of its inverse.

    Of several outputs with one noise if `products` has as many columns.
    """
    # In units of the prior's spread the matrix has no eigenvalue below one.
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
    """Give the noise precisions where the marginal likelihood's derivative is zero."""
    determined = len(alpha) - np.einsum("maa,a->m", covariance, alpha)
    residual = ((y - phi @ mean.T) ** 2).sum(axis=0)
    floor = 1e-8 * len(y) * y.var(axis=0)
    return np.maximum(len(y) - determined, 1e-3) / np.maximum(residual, floor)


def gain_at(alpha: np.ndarray, s: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Give l(alpha) for each basis: s and q are (M, B)."""
    total = np.log(alpha) - np.log(alpha + s) + q**2 / (alpha + s)
    return 0.5 * total.sum(axis=0)


def best_alpha(s: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give each basis' best finite precision and its l, which is not above zero if there is none.

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


def expectation_maximisation(
    phi: Float[np.ndarray, "n b"],
    y: Float[np.ndarray, "n m"],
    alpha: Float[np.ndarray, " b"],
    beta: Float[np.ndarray, " m"],
    steps: int,
) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, " m"], Float[np.ndarray, " steps"]]:
    """Climb the log marginal likelihood by EM, the weights being what is not seen.

        alpha_b = M / sum_m (mean_mb^2 + C_m,bb)
        1 / beta_m = (|y_m - Phi mean_m|^2 + tr(Phi C_m Phi^T)) / N

    Parameters
    ----------
    phi, y
        As for `maximise_marginal`.
    alpha, beta
        Where to begin.
    steps
        How many.

    Returns
    -------
    alpha, beta, and the log marginal likelihood before every step.
    """
    gram, products = phi.T @ phi, phi.T @ y
    history = []
    for _ in range(steps):
        history.append(log_marginal(phi, y, alpha, beta))
        found = [posterior(gram, products[:, m], alpha, one) for m, one in enumerate(beta)]
        mean = np.array([one for one, _, _ in found])
        covariance = np.array([one for _, one, _ in found])
        second = mean**2 + np.diagonal(covariance, axis1=1, axis2=2)
        alpha = y.shape[1] / second.sum(axis=0)
        residual = ((y - phi @ mean.T) ** 2).sum(axis=0)
        beta = len(y) / (residual + np.einsum("mab,ab->m", covariance, gram))
    return alpha, beta, np.array(history)
