"""Hidden Markov models with Brand's entropic prior (Brand 1999, Neural Computation 11).

States s_t follow a Markov chain of transitions A, and each emits a normal o_t:

    s_1 ~ Categorical(pi),   s_t ~ Categorical(A[s_{t-1}]),   o_t ~ N(mu_s, Sigma_s)

The prior of all that is learned goes by its entropy, p(theta) ~ exp(-H(theta)): what says
little is improbable. For the rows of A and for pi, H = -sum_i theta_i log theta_i; with
expected counts w the mode solves, for a multiplier lambda,

    w_i / theta_i + log theta_i + 1 + lambda = 0,    sum_i theta_i = 1,

by Lambert's W, and rare transitions die out. For a normal H = log|Sigma| / 2 + const, which
makes it Sigma = S / (n + 1) of the scatter S of n frames. A ridge keeps Sigma apart from zero:
a share of the data's own covariance counts as `RIDGE` frames more.

Learning is expectation and maximisation, which climbs the log posterior at each step.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

RIDGE = 5.0
TINY = 1e-12


class HMM(NamedTuple):
    """A chain of K states with normal emissions.

    initial, transition
        (K,) and (K, K), rows sum to one.
    mean, covariance
        (K, D) and (K, D, D).
    """

    initial: Float[np.ndarray, " k"]
    transition: Float[np.ndarray, "k k"]
    mean: Float[np.ndarray, "k d"]
    covariance: Float[np.ndarray, "k d d"]


class Learned(NamedTuple):
    """A chain, the states' probabilities (N, K) in training, and the log posteriors climbed."""

    hmm: HMM
    occupancy: Float[np.ndarray, "n k"]
    log_posterior: list[float]


def entropic(counts: Float[np.ndarray, "r k"]) -> Float[np.ndarray, "r k"]:
    """Give the mode of rows of probabilities under the entropic prior, from expected counts.

    With u_i = -log w_i - 1 - lambda, w_i / theta_i = v solves v - log v = u: the larger root
    where theta_i < w_i. Where the counts are so few that these do not reach one together, the
    most frequent takes the smaller root. Counts of zero have no probability; a row without
    counts has all alike.
    """
    seen = counts > TINY
    w = np.where(seen, counts, TINY)
    log_w = np.log(w)
    rows, top = np.arange(len(w)), np.argmax(w, axis=1)

    def total(level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u = -log_w - level[:, None]
        found = np.where(seen, w / _root(u), 0.0)
        small = w[rows, top] / _small_root(u[rows, top])
        found[few, top[few]] = small[few]
        return found.sum(axis=1), found

    # The largest 1 + lambda for which all have a root; at it the most frequent has v = 1.
    most = -1.0 - log_w[rows, top]
    few = np.zeros(len(w), bool)
    few = total(most)[0] < 1.0
    # Down from `most` the sum falls, or where the counts are few it rises.
    reach = np.ones(len(w))
    for _ in range(60):
        short = (total(most - reach)[0] > 1.0) != few
        if not short.any():
            break
        reach = np.where(short, 2.0 * reach, reach)
    low, high = most - reach, most
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = (total(middle)[0] > 1.0) != few
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    found = total(0.5 * (low + high))[1]
    empty = ~seen.any(axis=1)
    found[empty] = 1.0
    return found / found.sum(axis=1, keepdims=True)


def _root(u: np.ndarray) -> np.ndarray:
    """Solve v - log v = u for v >= 1, where u >= 1: minus Lambert's W of branch -1."""
    u = np.maximum(u, 1.0)
    v = u + np.log(u) + np.sqrt(2.0 * (u - 1.0))
    for _ in range(8):
        v = np.maximum(v - (v - np.log(v) - u) / np.maximum(1.0 - 1.0 / v, 1e-8), 1.0)
    return v


def _small_root(u: np.ndarray) -> np.ndarray:
    """Solve v - log v = u for v <= 1, where u >= 1: minus Lambert's W of branch 0."""
    u = np.maximum(u, 1.0)
    # Newton in t = log v, from below: e^t - t is convex and falls there.
    t = -u
    for _ in range(40):
        t = np.minimum(t + (np.exp(t) - t - u) / np.maximum(1.0 - np.exp(t), 1e-8), 0.0)
    return np.exp(t)


def log_entropic(theta: np.ndarray) -> float:
    """Log prior of probabilities, rows of them: minus their entropies."""
    return float(np.sum(np.where(theta > 0, theta * np.log(np.maximum(theta, 1e-300)), 0.0)))


def log_emissions(
    mean: Float[np.ndarray, "k d"],
    covariance: Float[np.ndarray, "k d d"],
    o: Float[np.ndarray, "t d"],
) -> Float[np.ndarray, "t k"]:
    """Log density of every frame under every state."""
    factor = np.linalg.cholesky(covariance)
    apart = np.linalg.solve(factor, (o[None] - mean[:, None]).transpose(0, 2, 1))
    logdet = np.sum(np.log(np.diagonal(factor, axis1=1, axis2=2)), axis=1)
    size = o.shape[1] * np.log(2.0 * np.pi)
    return (-0.5 * (np.sum(apart**2, axis=1) + size) - logdet[:, None]).T


def posterior_states(
    initial: np.ndarray, transition: np.ndarray, emission: Float[np.ndarray, "t k"]
) -> tuple[Float[np.ndarray, "t k"], Float[np.ndarray, "k k"], float]:
    """Forward and backward: states' probabilities, expected transitions, log likelihood."""
    shift = emission.max(axis=1)
    likely = np.exp(emission - shift[:, None])
    t, k = emission.shape
    forward, scale = np.empty((t, k)), np.empty(t)
    here = initial * likely[0]
    for i in range(t):
        if i:
            here = (forward[i - 1] @ transition) * likely[i]
        scale[i] = here.sum()
        forward[i] = here / scale[i]
    backward = np.ones((t, k))
    for i in range(t - 2, -1, -1):
        backward[i] = transition @ (likely[i + 1] * backward[i + 1]) / scale[i + 1]
    ahead = likely[1:] * backward[1:] / scale[1:, None]
    moves = transition * (forward[:-1].T @ ahead)
    return forward * backward, moves, float(np.sum(np.log(scale) + shift))


def learn(
    clips: Sequence[Float[np.ndarray, "_ d"]],
    states: int,
    *,
    seed: int,
    steps: int = 40,
    tolerance: float = 1e-5,
) -> Learned:
    """Learn a chain from clips of emissions; it begins with clusters of them.

    Parameters
    ----------
    states
        K.
    seed
        Of the clusters.
    steps, tolerance
        At most so many, until one gains less than this share of the log posterior.
    """
    from .clusters import find_clusters, nearest_centre

    every = np.concatenate(clips)
    whole = np.cov(every.T).reshape(every.shape[1], -1)
    nearest = nearest_centre(every, find_clusters(every, states, seed=seed).centre)
    occupancy = np.eye(states)[nearest]
    bounds = np.cumsum([len(clip) for clip in clips])[:-1]
    parts = np.split(occupancy, bounds)
    first = sum(part[0] for part in parts)
    moves = sum(part[:-1].T @ part[1:] for part in parts)
    climbed: list[float] = []
    hmm = _maximised(every, occupancy, first + 0.1, moves + 0.1, whole)
    for _ in range(steps):
        emission = np.split(log_emissions(hmm.mean, hmm.covariance, every), bounds)
        found = [posterior_states(hmm.initial, hmm.transition, part) for part in emission]
        climbed.append(sum(part[2] for part in found) + log_prior(hmm, whole))
        occupancy = np.concatenate([part[0] for part in found])
        if len(climbed) > 1 and climbed[-1] - climbed[-2] < tolerance * abs(climbed[-1]):
            break
        first, moves = (sum(part) for part in ([f[0][0] for f in found], [f[1] for f in found]))
        hmm = _maximised(every, occupancy, first, moves, whole)
    return Learned(hmm, occupancy, climbed)


def emissions_of(
    o: Float[np.ndarray, "n d"], occupancy: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, "k d"], Float[np.ndarray, "k d d"]]:
    """Give the most probable normals of states whose probabilities are known."""
    whole = np.cov(o.T).reshape(o.shape[1], -1)
    return _normals(o, occupancy, whole)


def log_prior(hmm: HMM, whole: Float[np.ndarray, "d d"]) -> float:
    """Log prior of a chain: entropic, with the ridge on covariances; constants left out."""
    logdet = np.linalg.slogdet(hmm.covariance)[1]
    ridge = np.trace(np.linalg.solve(hmm.covariance, RIDGE * whole[None]), axis1=1, axis2=2)
    normals = -0.5 * np.sum((1.0 + RIDGE) * logdet + ridge)
    return log_entropic(hmm.transition) + log_entropic(hmm.initial) + float(normals)


def _normals(o, occupancy, whole):
    n = occupancy.sum(axis=0)
    mean = occupancy.T @ o / np.maximum(n, TINY)[:, None]
    scatter = np.empty((len(n), o.shape[1], o.shape[1]))
    for k in range(len(n)):
        apart = o - mean[k]
        scatter[k] = (occupancy[:, k, None] * apart).T @ apart + RIDGE * whole
    return mean, scatter / (n + 1.0 + RIDGE)[:, None, None]


def _maximised(o, occupancy, first, moves, whole) -> HMM:
    normals = _normals(o, occupancy, whole)
    return HMM(entropic(first[None])[0], entropic(moves), *normals)
