"""Maximum likelihood of the mixture of PPCA by expectation and maximisation, in bounded memory.

With responsibilities r_nk the maximisation of each component is in closed form
(Tipping and Bishop 1999, section 3 and appendix C): with N_k = sum_n r_nk,

    pi_k = N_k / N,    mu_k = sum_n r_nk t_n / N_k
    S_k = sum_n r_nk (t_n - mu_k)(t_n - mu_k)^T / N_k
    sigma_k^2 = mean of the D - Q smaller eigenvalues of S_k
    W_k = U_Q (L_Q - sigma_k^2 I)^(1/2)        of its Q largest eigenvalues L and vectors U

A missing bin stands with its mean given those seen of its point, and the covariance of
missing bins given those seen is added to S_k. Points are worked on a batch at a time; what
is kept are K matrices (D, D). Densities need none: with M = W^T W + sigma^2 I = L L^T and
U = W L^-T

    (t - mu)^T C^-1 (t - mu) = (|t - mu|^2 - |U^T (t - mu)|^2) / sigma^2
    log |C| = (D - Q) log sigma^2 + log |M|
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import logsumexp, softmax

from ....errors import InputError
from ....search_state import SearchState
from ...clusters import Clusters, find_clusters, nearest_centre
from .density import Mixture

# Points whose densities are in memory together.
BATCH = 8192
# A responsibility below this says nothing of where a point came from.
NEGLIGIBLE = 1e-8
# The noise variance is at least this share of the points' overall variance, so that no
# component shrinks onto a few equal points.
FLOOR = 1e-4


def log_joint(mixture: Mixture, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n k"]:
    """Return log pi_k p(t_n | k), in the precision of the points; NaN is integrated out."""
    out = np.empty((len(points), len(mixture.weight)), dtype=points.dtype)
    for seen, rows in _patterns(points):
        out[rows] = _complete(_part(mixture, seen), points[rows][:, seen])
    return out


def log_density(mixture: Mixture, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Return log p(t_n)."""
    parts = [np.asarray(logsumexp(log_joint(mixture, b), axis=1)) for b in _batches(points)]
    return np.concatenate(parts)


def responsibilities(
    mixture: Mixture, points: Float[np.ndarray, "n d"]
) -> Float[np.ndarray, "n k"]:
    """Return p(k | t_n), in the precision of the points."""
    return np.asarray(softmax(log_joint(mixture, points), axis=1))


def completed(
    points: Float[np.ndarray, "n d"], location: Float[np.ndarray, " d"]
) -> Float[np.ndarray, "n d"]:
    """Return the points with the location in the place of missing bins."""
    missing = np.isnan(points)
    return np.where(missing, location.astype(points.dtype), points) if missing.any() else points


def _complete(mixture: Mixture, points: np.ndarray) -> np.ndarray:
    """Return the log joint of points without missing bins, by matrix products."""
    dtype, noise = points.dtype, np.asarray(mixture.noise)
    K, D, Q = mixture.factor.shape
    # Measured from the centre, so that squares hardly cancel.
    centre = mixture.mean.mean(axis=0)
    mean = mixture.mean - centre
    M = mixture.factor.swapaxes(1, 2) @ mixture.factor + noise[:, None, None] * np.eye(Q)
    L = np.linalg.cholesky(M)
    U = np.linalg.solve(L, mixture.factor.swapaxes(1, 2)).swapaxes(1, 2)
    shift = np.einsum("kd,kdq->kq", mean, U).astype(dtype)
    maps = U.transpose(1, 0, 2).reshape(D, K * Q).astype(dtype)
    log_det = (D - Q) * np.log(noise)
    log_det += 2.0 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
    with np.errstate(divide="ignore"):  # a component nothing belongs to
        constant = np.log(mixture.weight) - 0.5 * (D * np.log(2.0 * np.pi) + log_det)
    t = points - centre.astype(dtype)
    squared = -2.0 * (t @ mean.astype(dtype).T)
    squared += np.einsum("nd,nd->n", t, t)[:, None]
    squared += np.einsum("kd,kd->k", mean, mean).astype(dtype)
    inner = (t @ maps).reshape(len(t), *shift.shape) - shift
    squared -= np.einsum("nkq,nkq->nk", inner, inner)
    return constant.astype(dtype) - 0.5 * np.maximum(squared, 0.0) / noise.astype(dtype)


@dataclass(frozen=True)
class Estimate:
    """What EM found.

    mixture
        The mixture.
    log_likelihood
        Of all points, before every step and at the end.
    converged
        Whether the last step gained less than the tolerance.
    """

    mixture: Mixture
    log_likelihood: Float[np.ndarray, " steps"]
    converged: bool


def fit_mixture(
    points: Float[np.ndarray, "n d"],
    components: int,
    latent: int,
    *,
    seed: int,
    max_steps: int = 100,
    tolerance: float = 1e-6,
    start: Clusters | Mixture | None = None,
    progress: Callable[[int, float], None] | None = None,
    state: SearchState | None = None,
) -> Estimate:
    """Fit a mixture of PPCA by maximum likelihood.

    Parameters
    ----------
    points
        (N, D), NaN where missing; in single precision the densities are computed in it, sums
        always in double.
    components, latent
        K and Q.
    seed
        Of k-means++, where EM begins.
    max_steps
        At most so many steps.
    tolerance
        Gain of log likelihood, relative to its size, below which a step is the last.
    start
        Clusters to begin from, or a mixture to go on from, if they are known already.
    progress
        Called with the steps done and the log likelihood a point.
    state
        Where an earlier search stood, and where this one is kept.

    Raises
    ------
    InputError
        If there are fewer different points than components, or Q is not less than D.
    """
    if not 1 <= latent < points.shape[1]:
        raise InputError(
            "mixture", f"{latent} latent dimensions for points of {points.shape[1]}", "Use fewer"
        )
    floor = FLOOR * float(np.mean(np.nanvar(points, axis=0, dtype=np.float64)))
    state = state or SearchState()
    done, limit = state.steps(max_steps)
    history: list[float] = []
    if state.saved is not None:
        mixture = Mixture(*(state.saved[name] for name in Mixture._fields))
        history = state.saved["history"].tolist()
    elif isinstance(start, Mixture):
        mixture = start
    else:
        whole = completed(points, np.nanmean(points, axis=0, dtype=np.float64))
        clusters = start or find_clusters(whole, components, seed=seed)
        mixture = _first(whole, clusters, latent, floor)
    for step in range(done, limit):
        moments, total = _expect(points, mixture)
        history.append(total)
        if progress is not None:
            progress(step + 1, total / len(points))
        if step and history[-1] - history[-2] < tolerance * abs(history[-1]):
            return Estimate(mixture, np.array(history), True)
        mixture = _maximise(moments, mixture, floor)
        state.keep(step + 1, limit, partial(_kept, mixture, history))
    history.append(float(log_density(mixture, points).sum(dtype=np.float64)))
    return Estimate(mixture, np.array(history), False)


def _kept(mixture: Mixture, history: list[float]) -> dict[str, np.ndarray]:
    return {**mixture._asdict(), "history": np.array(history)}


@dataclass
class _Moments:
    """Sums over the points: r, r (t - mu), r (t - mu)(t - mu)^T for the means before."""

    count: np.ndarray
    first: np.ndarray
    second: np.ndarray

    @classmethod
    def none(cls, components: int, size: int) -> "_Moments":
        return cls(
            np.zeros(components), np.zeros((components, size)), np.zeros((components, size, size))
        )

    def add(self, component: int, away: np.ndarray, share: np.ndarray) -> None:
        weighted = away * share[:, None]
        self.count[component] += share.sum(dtype=np.float64)
        self.first[component] += weighted.sum(axis=0, dtype=np.float64)
        self.second[component] += weighted.T @ away


def _first(points: np.ndarray, start: Clusters, latent: int, floor: float) -> Mixture:
    """Make the mixture of the clusters, each point wholly of its nearest."""
    K, D = start.centre.shape
    mean = start.centre.astype(float)
    before = Mixture(np.full(K, 1.0 / K), mean, np.zeros((K, D, latent)), np.ones(K))
    nearest = nearest_centre(points, start.centre)
    moments = _Moments.none(K, D)
    for k in range(K):
        own = points[nearest == k].astype(float)
        moments.add(k, own - mean[k], np.ones(len(own)))
    return _maximise(moments, before, floor)


def _expect(points: np.ndarray, mixture: Mixture) -> tuple[_Moments, float]:
    """Sum up the responsibilities and what they weight; return the log likelihood too."""
    moments = _Moments.none(*mixture.mean.shape)
    total = 0.0
    mean = mixture.mean.astype(points.dtype)
    for batch in _batches(points):
        for seen, rows in _patterns(batch):
            part = batch[rows]
            share, log_density = _normalised(_complete(_part(mixture, seen), part[:, seen]))
            total += float(log_density.sum(dtype=np.float64))
            for k in range(len(mean)):
                own = np.flatnonzero(share[:, k] > NEGLIGIBLE)
                if len(own):
                    away = part[own] - mean[k]
                    if not seen.all():
                        _fill(moments, mixture, k, seen, away, share[own, k])
                    moments.add(k, away, share[own, k])
    return moments, total


def _fill(
    moments: _Moments, mixture: Mixture, k: int, seen: np.ndarray, away: np.ndarray,
    share: np.ndarray,
) -> None:  # fmt: skip
    """Put means into `away` where bins are missing, and add their covariance to the moments."""
    W, noise = mixture.factor[k], mixture.noise[k]
    M = W[seen].T @ W[seen] + noise * np.eye(W.shape[1])
    away[:, ~seen] = away[:, seen] @ W[seen] @ np.linalg.solve(M, W[~seen].T)
    left = noise * (W[~seen] @ np.linalg.solve(M, W[~seen].T) + np.eye((~seen).sum()))
    moments.second[k][np.ix_(~seen, ~seen)] += share.sum(dtype=np.float64) * left


def _maximise(moments: _Moments, before: Mixture, floor: float) -> Mixture:
    """Return each component's closed-form maximum; one that is nearly empty stays as it was."""
    D, Q = before.factor.shape[1:]
    weight = moments.count / moments.count.sum()
    mean, factor, noise = (np.array(part) for part in before[1:])
    for k in np.flatnonzero(moments.count > 1.0):
        moved = moments.first[k] / moments.count[k]
        S = moments.second[k] / moments.count[k] - np.outer(moved, moved)
        values, vectors = np.linalg.eigh((S + S.T) / 2)
        noise[k] = max(values[: D - Q].mean(), floor)
        stretch = np.sqrt(np.maximum(values[D - Q :] - noise[k], 0.0))
        factor[k] = (vectors[:, D - Q :] * stretch)[:, ::-1]
        mean[k] = mean[k] + moved
    return Mixture(weight, mean, factor, noise)


def _normalised(log_joint: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return responsibilities and log densities."""
    top = log_joint.max(axis=1, keepdims=True)
    share = np.exp(log_joint - top)
    total = share.sum(axis=1, keepdims=True)
    return share / total, (top + np.log(total))[:, 0]


def _batches(points: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the points, `BATCH` at a time."""
    for first in range(0, len(points), BATCH):
        yield points[first : first + BATCH]


def _patterns(points: np.ndarray) -> Iterator[tuple[Bool[np.ndarray, " d"], slice | np.ndarray]]:
    """Yield which bins are seen together, and the rows of which they are."""
    missing = np.isnan(points)
    if not missing.any():
        yield np.ones(points.shape[1], dtype=bool), slice(None)
        return
    found, which = np.unique(missing, axis=0, return_inverse=True)
    for number, one in enumerate(found):
        yield ~one, np.flatnonzero(which == number)


def _part(mixture: Mixture, seen: np.ndarray) -> Mixture:
    """Return the mixture of the bins seen: of their rows of mu and W."""
    if seen.all():
        return mixture
    return mixture._replace(mean=mixture.mean[:, seen], factor=mixture.factor[:, seen])
