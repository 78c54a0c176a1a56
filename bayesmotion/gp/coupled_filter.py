"""Columns that mix independent Matern processes, with missing entries: exact smoothing.

y_t = V^T f_t + e_t, of which entries may be missing, with V (R, C) orthonormal and e of variance
one. Where all of y_t is seen, V y_t are R columns of their own (`state_space`); where some is
missing the processes have to be filtered together, in O(N (R k)^3). That is for windows about
gaps.
"""

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_factor, cho_solve
from jaxtyping import Array, Float

from .linalg import AnyArray
from .state_space import StateSpace


def _blocks(each: Float[AnyArray, "r k k"]) -> Float[Array, "m m"]:
    r, k, _ = each.shape
    return jnp.einsum("rij,rs->risj", jnp.asarray(each), jnp.eye(r)).reshape(r * k, r * k)


@jax.jit
def smooth_coupled(
    processes: StateSpace,
    mixing: Float[AnyArray, "r c"],
    y: Float[AnyArray, "n c"],
    seen: Float[AnyArray, "n c"],
) -> tuple[Float[Array, "n c"], Float[Array, "n c"]]:
    """Return mean and variance of V^T f_t given all that is seen.

    Parameters
    ----------
    processes
        R of them.
    mixing
        V.
    y
        In sd of the noise; anything finite where missing.
    seen
        1 where seen, else 0.
    """
    r, k = processes.transition.shape[:2]
    transition = jnp.asarray(processes.transition)
    innovation, stationary = _blocks(processes.innovation), _blocks(processes.stationary)
    first = jnp.einsum("rs,k->rsk", jnp.eye(r), jnp.eye(k)[0]).reshape(r, r * k)
    whole = jnp.asarray(mixing).T @ first
    identity = jnp.eye(r * k)

    def moved(rows):
        """Return A times rows (m, .)."""
        parts = rows.reshape(r, k, -1)
        return jnp.einsum("rij,rjm->rim", transition, parts).reshape(rows.shape)

    def pulled(rows):
        """Return A^T times rows (m, .)."""
        parts = rows.reshape(r, k, -1)
        return jnp.einsum("rji,rjm->rim", transition, parts).reshape(rows.shape)

    def forth(state, now):
        mean, cov = state
        value, known = now
        observe = known[:, None] * whole
        side = observe @ cov
        factor = cho_factor(side @ observe.T + jnp.eye(observe.shape[0]), lower=True)
        gain = cho_solve(factor, side).T
        off = known * (value - observe @ mean)
        kept = (mean, cov, observe, gain, cho_solve(factor, off), cho_solve(factor, observe))
        cov = cov - gain @ side
        cov = moved(moved(0.5 * (cov + cov.T)).T).T + innovation
        return (moved(mean + gain @ off), cov), kept

    def back(carry, kept):
        pull, big = carry
        mean, cov, observe, gain, weighed, solved = kept
        pull, big = pulled(pull), pulled(pulled(big).T).T
        # Both factors as they stand: what remains of a known entry is a small difference.
        closed = identity - gain @ observe
        pull = observe.T @ weighed + closed.T @ pull
        big = observe.T @ solved + closed.T @ (0.5 * (big + big.T)) @ closed
        side = whole @ cov
        variance = jnp.sum(side * whole, axis=1) - jnp.sum((side @ big) * side, axis=1)
        return (pull, big), (whole @ mean + side @ pull, variance)

    begin = (jnp.zeros(r * k), stationary)
    _, kept = jax.lax.scan(forth, begin, (jnp.asarray(y), jnp.asarray(seen)))
    end = (jnp.zeros(r * k), jnp.zeros((r * k, r * k)))
    _, (mean, variance) = jax.lax.scan(back, end, kept, reverse=True)
    return mean, jnp.maximum(variance, 0.0)
