"""Matern processes in time as state spaces: densities and smoothing in O(N).

A Matern process f of smoothness nu = p + 1/2 and rate lambda = sqrt(2 nu) / length is the first
entry of x = (f, f' / lambda, ..., f^(p) / lambda^p), which is Markov:

    x_(t+1) = A x_t + q_t,   q_t ~ N(0, s^2 Q),   x_1 ~ N(0, s^2 P),   y_t = h x_t + e_t,

at frames one unit of time apart. The noise e_t has variance one: everything is in its sd. What is
missing is marginalised. Columns of y are independent and share a process, so the covariances of
the filter are those of a pattern of missing entries, and not of a column.
"""

from math import comb, factorial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.linalg import solve_continuous_lyapunov

from .linalg import AnyArray

# Nodes of the integral that gives Q: a sum of positive terms, which loses no digits for processes
# much slower than a frame.
NODES = 30


class StateSpace(NamedTuple):
    """A process, or several of one size behind each other.

    transition
        A (..., k, k).
    innovation
        s^2 Q (..., k, k).
    stationary
        s^2 P (..., k, k).
    """

    transition: Float[AnyArray, "*g k k"]
    innovation: Float[AnyArray, "*g k k"]
    stationary: Float[AnyArray, "*g k k"]


class Columns(NamedTuple):
    """Columns of values with what of them is seen.

    y
        (N, C) in sd of the noise; anything finite where missing.
    seen
        (N, P) 1 where the columns of a pattern are seen, else 0.
    which
        (C,) pattern of every column.
    """

    y: Float[AnyArray, "n c"]
    seen: Float[AnyArray, "n p"]
    which: Int[AnyArray, " c"]


def matern(order: int, length: float, sd: float, size: int) -> StateSpace:
    """Return the Matern process of smoothness order + 1/2.

    Parameters
    ----------
    order
        Number of times the process can be differentiated.
    length
        Length scale in frames.
    sd
        Of the process, in sd of the noise.
    size
        Entries of the state; those beyond order + 1 stay zero.

    Examples
    --------
    >>> from bayesmotion.gp.state_space import matern
    >>> matern(1, 10.0, 2.0, 3).stationary[0, 0]
    4.0
    """
    k = order + 1
    drift = np.diag(np.ones(order), 1)
    drift[-1] = [-comb(k, j) for j in range(k)]
    nilpotent = drift + np.eye(k)
    driven = np.eye(k)[-1]
    stationary = solve_continuous_lyapunov(drift, -np.outer(driven, driven))
    density = 1.0 / stationary[0, 0]
    step = np.sqrt(2 * order + 1) / length

    def propagator(time: float) -> np.ndarray:
        powers = (np.linalg.matrix_power(nilpotent, j) * time**j / factorial(j) for j in range(k))
        return np.exp(-time) * sum(powers)

    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    moved = np.stack([propagator(time) @ driven for time in 0.5 * step * (nodes + 1.0)])
    innovation = density * np.einsum("q,qi,qj->ij", 0.5 * step * weights, moved, moved)
    fill = ((0, size - k), (0, size - k))
    parts = (propagator(step), sd**2 * innovation, sd**2 * density * stationary)
    return StateSpace(*(np.pad(part, fill) for part in parts))


def columns(y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"] | None = None) -> Columns:
    """Return columns with their patterns; all is seen where that is not said."""
    seen = np.ones(y.shape, bool) if seen is None else seen
    patterns, which = np.unique(seen, axis=1, return_inverse=True)
    return Columns(np.where(seen, y, 0.0), patterns.astype(float), which.reshape(-1))


def _update(mean, cov, y, seen, which):
    """Return S, the gain and v of one frame: those of what is missing are 1 and 0."""
    variance = jnp.where(seen > 0.0, cov[:, 0, 0] + 1.0, 1.0)
    gain = seen[:, None] * cov[:, :, 0] / variance[:, None]
    return variance, gain, seen[which] * (y - mean[:, 0])


def _forward(process: StateSpace, data: Columns):
    """Return the step of the filter, and what it begins with."""
    transition = jnp.asarray(process.transition)
    patterns, count, k = data.seen.shape[1], data.y.shape[1], transition.shape[-1]
    begin = (
        jnp.zeros((count, k)),
        jnp.broadcast_to(jnp.asarray(process.stationary), (patterns, k, k)),
    )

    def step(mean, cov, y, seen):
        variance, gain, off = _update(mean, cov, y, seen, data.which)
        mean = mean + off[:, None] * gain[data.which]
        cov = cov - variance[:, None, None] * gain[:, :, None] * gain[:, None, :]
        cov = transition @ cov @ transition.T + process.innovation
        return (mean @ transition.T, cov), (variance, gain, off)

    return begin, step


def log_density(process: StateSpace, data: Columns) -> Float[Array, " c"]:
    """Return the log density of what is seen of every column, but for -n log(2 pi) / 2."""
    begin, step = _forward(process, data)

    def body(carry, now):
        (mean, cov), total = carry
        state, (variance, _, off) = step(mean, cov, *now)
        total = total + jnp.log(variance)[data.which] + off**2 / variance[data.which]
        return (state, total), None

    start = (begin, jnp.zeros(data.y.shape[1]))
    (_, total), _ = jax.lax.scan(body, start, (jnp.asarray(data.y), jnp.asarray(data.seen)))
    return -0.5 * total


def smooth(process: StateSpace, data: Columns) -> tuple[Float[Array, "n c"], Float[Array, "n p"]]:
    """Return the mean of f given all that is seen, and its variance of every pattern.

    By the backward recursion of Bryson and Frazier (Durbin and Koopman, Time Series Analysis by
    State Space Methods, 4.4), which inverts nothing.
    """
    begin, step = _forward(process, data)
    transition = jnp.asarray(process.transition)
    k = transition.shape[-1]
    first = jnp.eye(k)[0]

    def forth(state, now):
        after, told = step(*state, *now)
        return after, (*state, *told, now[1])

    def back(carry, kept):
        r, big = carry
        mean, cov, variance, gain, off, seen = kept
        weight = seen / variance
        closed = transition @ (jnp.eye(k) - gain[:, :, None] * first)
        r = (off * weight[data.which])[:, None] * first + jnp.einsum(
            "ck,ckj->cj", r, closed[data.which]
        )
        big = weight[:, None, None] * jnp.outer(first, first) + (
            jnp.swapaxes(closed, 1, 2) @ big @ closed
        )
        side = cov[:, :, 0]
        told = mean[:, 0] + jnp.einsum("ck,ck->c", r, side[data.which])
        return (r, big), (told, cov[:, 0, 0] - jnp.einsum("pi,pij,pj->p", side, big, side))

    _, kept = jax.lax.scan(forth, begin, (jnp.asarray(data.y), jnp.asarray(data.seen)))
    end = (jnp.zeros_like(begin[0]), jnp.zeros_like(begin[1]))
    _, (mean, variance) = jax.lax.scan(back, end, kept, reverse=True)
    return mean, jnp.maximum(variance, 0.0)


@jax.jit
def log_densities(processes: StateSpace, data: Columns) -> Float[Array, "g c"]:
    """Return `log_density` of every one of several processes."""
    return jax.lax.map(lambda process: log_density(process, data), processes)


@jax.jit
def smooth_mixture(
    processes: StateSpace, weight: Float[AnyArray, "g c"], data: Columns
) -> tuple[Float[Array, "n c"], Float[Array, "n c"]]:
    """Return mean and variance of f of every column, mixed over processes by their weights."""
    zero = jnp.zeros(data.y.shape)

    def add(total, one):
        process, share = one
        mean, variance = smooth(process, data)
        return (
            total[0] + share * mean,
            total[1] + share * (variance[:, data.which] + mean**2),
        ), None

    (mean, square), _ = jax.lax.scan(add, (zero, zero), (processes, jnp.asarray(weight)))
    return mean, jnp.maximum(square - mean**2, 0.0)
