"""The chains of a calibration: NUTS on a density, many of them side by side.

A chain starts at the true values: theta is itself a draw from the posterior of its data,
so a chain that begins there needs no burn-in. After the iterations of adaptation it is
put back to theta, and once more at a random one of the L draws: as NUTS is reversible,
theta is then one of L + 1 successive states of one stationary chain, at a random place,
and its rank is uniform however slowly the chain moves (Besag and Clifford 1989). That
checks the density and the sampler's moves; it does not check that the sampler finds
its way. ``start="prior"`` begins at another draw from the prior instead: where data are
few, the posterior of steps and phases has regions that NUTS does not cross between.

The chain moves on z with u = u_start + R z, R R^T the inverse of the Hessian at the
start: scales and correlations that a short adaptation would not find.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, PRNGKeyArray
from numpyro import infer

Start = Literal["truth", "prior"]
STEP, LEAST_CURVATURE = 1e-4, 0.1


@dataclass(frozen=True)
class Chains:
    """How the chain of every simulation is run.

    warmup
        Iterations of adaptation.
    draws
        L, the draws kept for the ranks.
    thin
        Iterations for each of them.
    depth
        NUTS's trees have at most 2^depth leapfrogs.
    start
        ``truth`` or ``prior``, see the module.
    """

    warmup: int = 150
    draws: int = 50
    thin: int = 4
    depth: int = 5
    start: Start = "truth"


def chain(
    settings: Chains,
    key: PRNGKeyArray,
    density: Callable[[dict[str, Array], tuple], Array],
    start: dict[str, Array],
    data: tuple,
) -> tuple[dict[str, Array], Array, Array]:
    """Run NUTS; give the draws kept, and divergences and leapfrogs between them."""
    at, unravel = ravel_pytree(start)
    root = _root(_curvature(jax.grad(lambda u: -density(unravel(u), data)), at))
    kernel = infer.NUTS(
        potential_fn=lambda z: -density(unravel(at + root @ z), data), max_tree_depth=settings.depth
    )
    when_key, key = jax.random.split(key)
    first = kernel.init(key, settings.warmup, init_params=jnp.zeros(len(at)))
    # Warm-up runs in the same loop, so that NUTS is compiled once; its draws are left out.
    skipped = -(-settings.warmup // settings.thin)
    turn = skipped + jax.random.randint(when_key, (), 0, settings.draws + 1)

    def iteration(_, carry):
        state, diverged, leapfrogs = carry
        state = kernel.sample(state, (), {})
        return state, diverged + state.diverging, leapfrogs + state.num_steps

    def block(state, index):
        if settings.start == "truth":
            back = (index == skipped) | (index == turn)
            state = _back(back, first, state)
        none = jnp.zeros((), int)
        state, *counts = jax.lax.fori_loop(0, settings.thin, iteration, (state, none, none))
        return state, (state.z, *counts)

    _, out = jax.lax.scan(block, first, jnp.arange(skipped + settings.draws))
    z, diverged, leapfrogs = jax.tree.map(lambda leaf: leaf[skipped:], out)
    return jax.vmap(lambda z: unravel(at + root @ z))(z), diverged, leapfrogs


def _back(when: Array, first: Any, state: Any) -> Any:
    """Put a chain back to where it began, with what it has learned since."""
    place = ("z", "z_grad", "potential_energy")
    return state._replace(
        **{name: jnp.where(when, getattr(first, name), getattr(state, name)) for name in place}
    )


def _curvature(gradient: Callable[[Array], Array], at: Array) -> Array:
    """Give the Hessian by differences: a scale for the sampler needs no more."""
    away = STEP * jnp.eye(len(at))
    up, down = jax.lax.map(
        lambda d: gradient(at + d), jnp.stack([away, -away]).reshape(-1, len(at))
    ).reshape(2, len(at), -1)
    slope = (up - down) / (2.0 * STEP)
    return 0.5 * (slope + slope.T)


def _root(curvature: Array) -> Array:
    """Give a root of the covariance that a Gaussian with this curvature would have.

    Directions that curve the wrong way count by the size of their curvature.
    """
    sizes, directions = jnp.linalg.eigh(curvature)
    return directions / jnp.sqrt(jnp.maximum(jnp.abs(sizes), LEAST_CURVATURE))
