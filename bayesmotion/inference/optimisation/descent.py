"""BFGS with backtracking inside a compiled program.

Line searches of libraries evaluate the function in several places, and all that a function
computes is compiled once for each of them. Here it is evaluated in one place, the body of the
loop, whatever the step turns out to be.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

# Of the decrease that the slope promises, so much is asked for (Armijo).
ENOUGH = 1e-4
SHORTEST = 1e-10


class Descent(NamedTuple):
    """Where a search has come to.

    x, value, gradient
        The best point.
    inverse
        Approximate inverse of the Hessian.
    step
        Share of the quasi-Newton step that is tried next.
    evaluations
        Done so far.
    """

    x: Float[Array, " n"]
    value: Float[Array, ""]
    gradient: Float[Array, " n"]
    inverse: Float[Array, "n n"]
    step: Float[Array, ""]
    evaluations: Int[Array, ""]


def descend(
    function: Callable[[Float[Array, " n"]], Float[Array, ""]],
    begin: Float[Array, " n"],
    *,
    evaluations: int,
    slope: float = 1e-5,
) -> Descent:
    """Search for a minimum of a function, from a point where it is about of unit curvature.

    Parameters
    ----------
    function
        Of points; where it is not finite no step is taken.
    begin
        Where the search begins.
    evaluations
        How often the function and its gradient are evaluated at most.
    slope
        The search ends where no entry of the gradient is larger.

    Returns
    -------
    The lowest point that was found: never above `begin`. Its value is infinite where the
    function is not finite at `begin`.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> found = descend(lambda x: jnp.sum((x - 2.0) ** 2), jnp.zeros(3), evaluations=20)
    >>> found.x.round(4).tolist()
    [2.0, 2.0, 2.0]
    """
    evaluate = jax.value_and_grad(function)
    eye, zero = jnp.eye(len(begin)), jnp.zeros(len(begin))
    # Nothing is known yet: the first trial is `begin` itself, and any finite value is accepted.
    first = Descent(begin, jnp.array(jnp.inf), zero, eye, jnp.array(1.0), jnp.array(0))

    def goes_on(state: Descent) -> Bool[Array, ""]:
        steep = jnp.max(jnp.abs(state.gradient)) > slope
        begun = (state.evaluations == 0) | (jnp.isfinite(state.value) & steep)
        return begun & (state.evaluations < evaluations) & (state.step > SHORTEST)

    def body(state: Descent) -> Descent:
        move = -state.step * (state.inverse @ state.gradient)
        value, gradient = evaluate(state.x + move)
        finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(gradient))
        better = finite & (value <= state.value + ENOUGH * jnp.vdot(state.gradient, move))
        learned = _learned(state.inverse, move, gradient - state.gradient)
        return Descent(
            jnp.where(better, state.x + move, state.x),
            jnp.where(better, value, state.value),
            jnp.where(better, gradient, state.gradient),
            jnp.where(better, learned, state.inverse),
            jnp.where(better, 1.0, 0.3 * state.step),
            state.evaluations + 1,
        )

    return jax.lax.while_loop(goes_on, body, first)


def _learned(
    inverse: Float[Array, "n n"], move: Float[Array, " n"], change: Float[Array, " n"]
) -> Float[Array, "n n"]:
    """Return the inverse after a move and the change of the gradient along it, if it is upwards."""
    along = jnp.vdot(move, change)
    upwards = along > 1e-12 * jnp.linalg.norm(move) * jnp.linalg.norm(change)
    rate = 1.0 / jnp.where(upwards, along, 1.0)
    left = jnp.eye(len(move)) - rate * jnp.outer(move, change)
    return jnp.where(upwards, left @ inverse @ left.T + rate * jnp.outer(move, move), inverse)
