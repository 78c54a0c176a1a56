"""Maximum likelihood of the mixture of PPCA by expectation and maximisation, in bounded memory.

With responsibilities r_nk the maximisation of each component is in closed form
(Tipping and Bishop 1999, section 3 and appendix C): with N_k = sum_n r_nk,

    pi_k = N_k / N,    mu_k = sum_n r_nk t_n / N_k
    S_k = sum_n r_nk (t_n - mu_k)(t_n - mu_k)^T / N_k
    sigma_k^2 = mean of the D - Q smaller eigenvalues of S_k
    W_k = U_Q (L_Q - sigma_k^2 I)^(1/2)        of its Q largest eigenvalues L and vectors U

Points are worked on a batch at a time; what is kept are K matrices (D, D). The densities
need no (D, D) matrix: with M = W^T W + sigma^2 I = L L^T and U = W L^-T

    (t - mu)^T C^-1 (t - mu) = (|t - mu|^2 - |U^T (t - mu)|^2) / sigma^2
    log |C| = (D - Q) log sigma^2 + log |M|
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from ..errors import InputError
from .clusters import Clusters, batches, find_clusters, nearest_centre

# A responsibility below this says nothing of where a point came from.
NEGLIGIBLE = 1e-8
# The noise variance is at least this share of the points' overall variance, so that no
# component shrinks onto a few equal points.
FLOOR = 1e-4


@dataclass(frozen=True)
class Mixture:
    """A mixture of K probabilistic principal component analysers.

    weight
        (K,) pi.
    mean
        (K, D) mu.
    factor
        (K, D, Q) W.
    noise
        (K,) sigma^2.
    """

    weight: Float[np.ndarray, " k"]
    mean: Float[np.ndarray, "k d"]
    factor: Float[np.ndarray, "k d q"]
    noise: Float[np.ndarray, " k"]

    def log_joint(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n k"]:
        """Give log pi_k p(t_n | k), in the precision of the points."""
        dtype = points.dtype
        middle, mean, maps, shift, constant, noise = self._prepared
        t = points - middle.astype(dtype)
        squared = -2.0 * (t @ mean.astype(dtype).T)
        squared += np.einsum("nd,nd->n", t, t)[:, None]
        squared += np.einsum("kd,kd->k", mean, mean).astype(dtype)
        inner = (t @ maps.astype(dtype)).reshape(len(t), *shift.shape) - shift.astype(dtype)
        squared -= np.einsum("nkq,nkq->nk", inner, inner)
        return constant.astype(dtype) - 0.5 * np.maximum(squared, 0.0) / noise.astype(dtype)

    def log_density(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
        """Give log p(t_n)."""
        return np.concatenate(
            [np.asarray(logsumexp(self.log_joint(b), axis=1)) for b in batches(points)]
        )

    def responsibilities(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n k"]:
        """Give p(k | t_n)."""
        return _normalised(self.log_joint(points))[0]

    def covariance(self, component: int) -> Float[np.ndarray, "d d"]:
        """Give C_k."""
        W = self.factor[component]
        return W @ W.T + self.noise[component] * np.eye(len(W))

    @cached_property
    def _prepared(self) -> tuple[np.ndarray, ...]:
        """Centre, centred means, all maps U side by side, their shifts, constants, noise."""
        K, D, Q = self.factor.shape
        middle = self.mean.mean(axis=0)
        mean = self.mean - middle
        M = self.factor.swapaxes(1, 2) @ self.factor + self.noise[:, None, None] * np.eye(Q)
        L = np.linalg.cholesky(M)
        U = np.linalg.solve(L, self.factor.swapaxes(1, 2)).swapaxes(1, 2)
        shift = np.einsum("kd,kdq->kq", mean, U)
        log_det = (D - Q) * np.log(self.noise)
        log_det += 2.0 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
        with np.errstate(divide="ignore"):  # a component nothing belongs to
            constant = np.log(self.weight) - 0.5 * (D * np.log(2.0 * np.pi) + log_det)
        maps = U.transpose(1, 0, 2).reshape(D, K * Q)
        return middle, mean, maps, shift, constant, self.noise


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
    tolerance: float = 1e-5,
    start: Clusters | Mixture | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Estimate:
    """Fit a mixture of PPCA by maximum likelihood.

    Parameters
    ----------
    points
        (N, D); in single precision the densities are computed in it, sums always in double.
    components, latent
        K and Q.
    seed
        Of k-means++, where EM begins.
    max_steps
        At most so many steps.
    tolerance
        Gain of log likelihood a point and step below which it has converged.
    start
        Clusters to begin from, or a mixture to go on from, if they are known already.
    progress
        Called with the steps done and the log likelihood a point.

    Raises
    ------
    InputError
        If there are fewer different points than components, or Q is not less than D.
    """
    if not 1 <= latent < points.shape[1]:
        raise InputError(
            "mixture", f"{latent} latent dimensions for points of {points.shape[1]}", "Use fewer"
        )
    floor = FLOOR * float(np.mean(np.var(points, axis=0, dtype=np.float64)))
    if isinstance(start, Mixture):
        mixture = start
    else:
        clusters = start or find_clusters(points, components, seed=seed)
        mixture = _first(points, clusters, latent, floor)
    history: list[float] = []
    for step in range(max_steps):
        moments, total = _expect(points, mixture)
        history.append(total)
        if progress is not None:
            progress(step + 1, total / len(points))
        if step and history[-1] - history[-2] < tolerance * len(points):
            return Estimate(mixture, np.array(history), True)
        mixture = _maximise(moments, mixture, floor)
    history.append(float(mixture.log_density(points).sum(dtype=np.float64)))
    return Estimate(mixture, np.array(history), False)


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
    """Sum up the responsibilities and what they weight; give the log likelihood too."""
    moments = _Moments.none(*mixture.mean.shape)
    total = 0.0
    mean = mixture.mean.astype(points.dtype)
    for part in batches(points):
        share, log_density = _normalised(mixture.log_joint(part))
        total += float(log_density.sum(dtype=np.float64))
        for k in range(len(mean)):
            own = np.flatnonzero(share[:, k] > NEGLIGIBLE)
            if len(own):
                moments.add(k, part[own] - mean[k], share[own, k])
    return moments, total


def _maximise(moments: _Moments, before: Mixture, floor: float) -> Mixture:
    """Give each component's closed-form maximum; one that is nearly empty stays as it was."""
    D, Q = before.factor.shape[1:]
    weight = moments.count / moments.count.sum()
    mean, factor, noise = before.mean.copy(), before.factor.copy(), before.noise.copy()
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
    """Give responsibilities and log densities."""
    top = log_joint.max(axis=1, keepdims=True)
    share = np.exp(log_joint - top)
    total = share.sum(axis=1, keepdims=True)
    return share / total, (top + np.log(total))[:, 0]
