"""Brand's entropic prior of probabilities (Brand 1999, Neural Computation 11).

Probabilities that say little are improbable:

    p(theta) = exp(-H(theta)) / Z_K,    H = -sum_i theta_i log theta_i

on the simplex of K probabilities. It lies between 1 / K and 1 before it is divided by Z_K, so
it is a density, and draws come by rejection from uniform ones. Z_K is a number of quadrature.

With expected counts w the mode of sum_i w_i log theta_i - H(theta) solves, for a multiplier
lambda,

    w_i / theta_i + log theta_i + 1 + lambda = 0,    sum_i theta_i = 1,

by Lambert's W, and rare transitions die out.
"""

from functools import lru_cache
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpyro import distributions as dist
from numpyro.distributions import constraints
from scipy.interpolate import CubicSpline
from scipy.special import gammaln, lambertw

TINY = 1e-12
NODES = 200
FAR, TINIEST = 600.0, 1e-300


class EntropicSimplex(dist.Distribution):
    """The entropic prior of K probabilities."""

    arg_constraints: ClassVar = {}
    support = constraints.simplex  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_aux_fields = ("size",)

    def __init__(self, size: int, *, validate_args=None):
        self.size = size
        super().__init__(batch_shape=(), event_shape=(size,), validate_args=False)

    def log_prob(self, value):
        """Log density of probabilities (..., K) with respect to all but one of them."""
        log = jnp.log(jnp.maximum(value, jnp.finfo(jnp.result_type(float)).tiny))
        return jnp.sum(value * log, axis=-1) - log_normaliser(self.size)

    def sample(self, key=None, sample_shape=()):
        """Draw probabilities, uniform ones kept with probability exp(-H)."""
        assert key is not None, "a draw needs a key"
        draw = self._one
        for _ in sample_shape:
            draw = jax.vmap(draw)
        return draw(jax.random.split(key, sample_shape) if sample_shape else key)

    def _one(self, key):
        def again(state):
            key = jax.random.split(state[0], 3)
            theta = jax.random.dirichlet(key[1], jnp.ones(self.size))
            log = jnp.log(jnp.maximum(theta, jnp.finfo(theta.dtype).tiny))
            kept = jnp.log(jax.random.uniform(key[2])) < jnp.sum(theta * log)
            return key[0], theta, kept

        begun = (key, jnp.ones(self.size) / self.size, jnp.zeros((), bool))
        return jax.lax.while_loop(lambda state: ~state[2], again, begun)[1]


@lru_cache
def log_normaliser(size: int) -> float:
    """Return log Z_K = log of the integral of exp(-H) over the simplex.

    With f(t) = t^t and theta uniform, h_k(s) = E prod f(s theta_i) obeys, with u the first of
    k parts, h_k(s) = int (k - 1) (1 - u)^(k - 2) f(s u) h_{k-1}(s (1 - u)) du; the variable
    v = (1 - u)^(k - 1) is uniform.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    v, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    s = np.linspace(0.0, 1.0, 400) ** 2  # closer near zero, where t^t is steep
    h = _self_power(s)
    for k in range(2, size + 1):
        rest = v ** (1.0 / (k - 1))
        before = CubicSpline(np.sqrt(s), h)
        h = (_self_power(np.outer(s, 1.0 - rest)) * before(np.sqrt(np.outer(s, rest)))) @ weights
    return float(np.log(h[-1]) - gammaln(size))


def _self_power(t: np.ndarray) -> np.ndarray:
    return np.exp(t * np.log(np.maximum(t, 1e-300)))


def entropic(counts: Float[np.ndarray, "r k"]) -> Float[np.ndarray, "r k"]:
    """Return the mode of rows of probabilities under the entropic prior, from expected counts.

    With u_i = -log w_i - 1 - lambda, w_i / theta_i = v solves v - log v = u, for v >= 1: where
    the largest count is one or more, no probability exceeds its count. Rows of fewer counts
    have several modes (`_climbed`). Counts of zero have no probability; a row without counts
    has all alike.
    """
    seen = counts > TINY
    w = np.where(seen, counts, TINY)
    most = -1.0 - np.log(w.max(axis=1))  # the largest 1 + lambda for which all have a root

    def at(level: np.ndarray) -> np.ndarray:
        return np.where(seen, w / _root(-np.log(w) - level[:, None]), 0.0)

    # Down from `most` the sum falls.
    reach = np.ones(len(w))
    for _ in range(60):
        short = at(most - reach).sum(axis=1) > 1.0
        if not short.any():
            break
        reach = np.where(short, 2.0 * reach, reach)
    low, high = most - reach, most
    for _ in range(50):
        level = 0.5 * (low + high)
        above = at(level).sum(axis=1) > 1.0
        low, high = np.where(above, low, level), np.where(above, level, high)
    found = at(0.5 * (low + high))
    empty = ~seen.any(axis=1)
    few = (w.max(axis=1) < 1.0) & ~empty
    if few.any():
        found[few] = _climbed(np.where(seen, counts, 0.0)[few])
    found[empty] = 1.0
    return found / found.sum(axis=1, keepdims=True)


def _climbed(w: Float[np.ndarray, "r k"]) -> Float[np.ndarray, "r k"]:
    """Climb to the modes of rows of few counts, from these and from all at the most frequent.

    -H is convex and lies above its tangent: theta_i = w_i / (lambda - log theta_i') climbs.
    """
    even = w / np.maximum(w.sum(axis=1, keepdims=True), TINY)
    peak = np.eye(w.shape[1])[np.argmax(w, axis=1)]
    ends = []
    for share in (0.0, 0.999):
        theta = (1.0 - share) * even + share * peak
        for _ in range(200):
            log = np.where(w > 0, np.log(np.maximum(theta, TINIEST)), -np.inf)
            level = np.max(log + w, axis=1)  # from below, Newton climbs to the root
            for _ in range(12):
                part = w / (level[:, None] - log)
                slope = np.sum(part**2 / np.maximum(w, TINIEST), axis=1)
                total = part.sum(axis=1)
                level = level + (total - 1.0) * total / np.maximum(slope, TINIEST)
            theta = w / (level[:, None] - log)
            theta = theta / np.maximum(theta.sum(axis=1, keepdims=True), TINIEST)
        logs = np.log(np.maximum(theta, TINIEST))
        ends.append((theta, np.sum((w + theta) * logs, axis=1)))
    better = ends[1][1] > ends[0][1]
    return np.where(better[:, None], ends[1][0], ends[0][0])


def _root(u: np.ndarray) -> np.ndarray:
    """Solve v - log v = u for v >= 1: v = -W(-e^-u) with Lambert's W of branch -1.

    Where e^-u is nothing beside one, v = u + log v, which a few steps solve.
    """
    u = np.maximum(u, 1.0)
    far = u + np.log(u)
    for _ in range(4):
        far = u + np.log(far)
    return np.where(u < FAR, -lambertw(-np.exp(-np.minimum(u, FAR)), -1).real, far)
