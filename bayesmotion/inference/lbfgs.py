"""L-BFGS on a batch of starts, one function evaluation for all of them at a time.

Nocedal and Wright (2006), algorithm 7.4, with the weak Wolfe line search by
bisection of Lewis and Overton (2013). Written for a batch because a search
written for one start and vectorised pays for every branch of its line search
on every start; here a step costs one evaluation of the batch when the step of
length one is good for all, as it mostly is.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

ARMIJO, CURVATURE = 1e-4, 0.9
TRIALS = 20
# So many steps in a row that gain next to nothing end a search.
PATIENCE = 5

ValueAndGradient = Callable[[Array], tuple[Array, Array]]


class Search(NamedTuple):
    """Where a batch of S searches over n unknowns stands, with a memory of m steps.

    value, gradient
        Of the function that is made small, at u.
    moves, turns
        Past differences of u and of the gradient, the newest last.
    inverse
        1 / (move . turn), zero where there is no pair yet.
    still
        Steps in a row that gained next to nothing.
    steps
        Steps taken, -1 before the start has been evaluated.
    """

    u: Float[Array, "s n"]
    value: Float[Array, " s"]
    gradient: Float[Array, "s n"]
    moves: Float[Array, "m s n"]
    turns: Float[Array, "m s n"]
    inverse: Float[Array, "m s"]
    still: Int[Array, " s"]
    steps: Int[Array, " s"]


def begin(u: Float[Array, "s n"], memory: int) -> Search:
    """Give searches that are at u and have not been evaluated: their first step does that.

    It counts as step zero, and goes nowhere.
    """
    past = jnp.zeros((memory, *u.shape))
    zeros = jnp.zeros(len(u), dtype=int)
    nothing = jnp.zeros((memory, len(u)))
    value = jnp.full(len(u), jnp.inf)
    return Search(u, value, jnp.zeros_like(u), past, past, nothing, zeros, zeros - 1)


def step(
    function: ValueAndGradient, search: Search, halted: Bool[Array, " s"], tolerance: Array
) -> Search:
    """Take one step on every start that is not `halted`."""
    direction = _direction(search)
    slope = jnp.sum(direction * search.gradient, axis=1)
    # The memory can give a direction uphill when curvature was lost to rounding.
    uphill = slope >= 0.0
    direction = jnp.where(uphill[:, None], -search.gradient, direction)
    slope = jnp.where(uphill, -jnp.sum(search.gradient**2, axis=1), slope)
    # Without a memory the gradient says nothing about how far to go.
    blind = uphill | (search.inverse[-1] == 0.0)
    first = jnp.where(blind, 1.0 / (1.0 + jnp.linalg.norm(direction, axis=1)), 1.0)
    u, value, gradient, good = _line_search(function, search, direction, slope, first, halted)
    taken = good & ~halted
    # A start without a density stays infinite: there is nothing to gain.
    gain = jnp.where(good, search.value - value, 0.0)
    small = ~good | (gain <= tolerance * (jnp.abs(search.value) + 1.0))
    search = _remember(search, u - search.u, gradient - search.gradient, taken)
    # Where no step was found the memory misleads: the next step goes down the gradient.
    search = search._replace(inverse=jnp.where(good | halted, search.inverse, 0.0))
    keep = taken[:, None]
    lost = (search.steps < 0) & ~good
    still = jnp.where(lost, PATIENCE, jnp.where(small, search.still + 1, 0))
    return search._replace(
        u=jnp.where(keep, u, search.u),
        value=jnp.where(taken, value, search.value),
        gradient=jnp.where(keep, gradient, search.gradient),
        still=jnp.where(halted, search.still, still),
        steps=search.steps + taken,
    )


def _direction(search: Search) -> Float[Array, "s n"]:
    """Give minus the inverse Hessian's approximation times the gradient, by the two loops."""

    def backward(q, pair):
        move, turn, inverse = pair
        weight = inverse * jnp.sum(move * q, axis=1)
        return q - weight[:, None] * turn, weight

    def forward(q, pair):
        move, turn, inverse, weight = pair
        other = inverse * jnp.sum(turn * q, axis=1)
        return q + (weight - other)[:, None] * move, None

    pairs = (search.moves, search.turns, search.inverse)
    q, weights = jax.lax.scan(backward, search.gradient, pairs, reverse=True)
    curvature = search.inverse[-1] * jnp.sum(search.turns[-1] ** 2, axis=1)
    q = q / jnp.where(curvature > 0.0, curvature, 1.0)[:, None]
    return -jax.lax.scan(forward, q, (*pairs, weights))[0]


def _line_search(function, search, direction, slope, first, halted):
    """Find steps that meet the weak Wolfe conditions; lengths are bisected between bounds."""
    lanes = len(slope)

    def trial(carry):
        count, low, high, length, accepted, best = carry
        u = search.u + length[:, None] * direction
        value, gradient = function(u)
        sound = jnp.isfinite(value) & jnp.all(jnp.isfinite(gradient), axis=1)
        fall = sound & (value <= search.value + ARMIJO * length * slope)
        flat = jnp.sum(gradient * direction, axis=1) >= CURVATURE * slope
        # A step that falls far enough is kept, in case none is found that is also flat enough.
        use = fall & ~accepted
        best = tuple(
            jnp.where(use.reshape(-1, *[1] * (new.ndim - 1)), new, old)
            for new, old in zip((u, value, gradient, fall), best, strict=True)
        )
        low = jnp.where(fall & ~accepted, length, low)
        high = jnp.where(~fall & ~accepted, length, high)
        # A start that has not been evaluated takes this point as it is.
        accepted = accepted | (fall & flat) | (search.steps < 0)
        longer = jnp.where(jnp.isfinite(high), 0.5 * (low + high), 2.0 * length)
        return count + 1, low, high, jnp.where(accepted, length, longer), accepted, best

    def go_on(carry):
        return (carry[0] < TRIALS) & ~jnp.all(carry[4])

    start = (search.u, search.value, search.gradient, jnp.zeros(lanes, dtype=bool))
    carry = (0, jnp.zeros(lanes), jnp.full(lanes, jnp.inf), first, halted, start)
    return jax.lax.while_loop(go_on, trial, carry)[5]


def _remember(search: Search, move, turn, taken) -> Search:
    """Add a pair to the memory of the starts that took a step with positive curvature."""
    product = jnp.sum(move * turn, axis=1)
    size = jnp.linalg.norm(move, axis=1) * jnp.linalg.norm(turn, axis=1)
    use = taken & (product > 1e-12 * size)
    inverse = 1.0 / jnp.where(use, product, 1.0)

    def push(memory, new):
        shifted = jnp.concatenate([memory[1:], new[None]])
        return jnp.where(use.reshape(1, -1, *[1] * (memory.ndim - 2)), shifted, memory)

    return search._replace(
        moves=push(search.moves, move),
        turns=push(search.turns, turn),
        inverse=push(search.inverse, inverse),
    )
