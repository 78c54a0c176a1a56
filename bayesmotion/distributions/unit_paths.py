"""Draws of hyperparameters and latent paths of unit scale, together.

`distributions.dynamics.UnitScale` is the density of a path given that its scale r is one, with
a scale put before it, and a model's joint density of hyperparameters alpha and path x is

    p(alpha, x)  ~  p(alpha) path(unit_scale(x) | alpha) exp(-n / 2 (log r)^2):

alpha has not its prior's distribution, for some alpha make paths of unit scale more
readily than others. Exact draws are found by trying. With x of means m and movement
r u about them, u of unit scale, draws of p(alpha) path(x | alpha) have the density

    g(alpha, m, u, l) = p(alpha) path(m + e^l u | alpha) e^(n l),    l = log r.

Of those with |l| < `WINDOW` / n a draw is kept with probability g(., 0) / (`BOUND` g(., l)),
so that alpha, m and u of those kept have the density g(., 0), which is the one wanted.
Within so narrow a window the ratio is hardly ever larger than the bound; log r itself is
then drawn from N(1, 1 / n).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray
from numpyro import distributions as dist

from .dynamics import GPDynamics, at_scale, path_scale, unit_scale

WINDOW, BOUND = 0.3, 2.0
# Paths tried at once.
TRIED = 64


class _Search(NamedTuple):
    """Where a search for a path of unit scale stands."""

    key: PRNGKeyArray
    found: Array
    hyper: Float[Array, " a"]
    path: Float[Array, "n q"]


def draw_unit_path(
    key: PRNGKeyArray, prior: dist.Distribution, path_of: Callable[[Array], GPDynamics]
) -> tuple[Float[Array, " a"], Float[Array, "n q"]]:
    """Draw hyperparameters and a path from their joint distribution, under `UnitScale`.

    Parameters
    ----------
    key
        Random key.
    prior
        Of the hyperparameters (A,).
    path_of
        The distribution of paths of any scale with such hyperparameters; it must be a
        normalised one (weight 1).
    """
    scale_key, key = jax.random.split(key)

    def attempt(key: PRNGKeyArray) -> tuple[Array, Array, Array]:
        hyper_key, path_key, luck_key = jax.random.split(key, 3)
        hyper = jnp.asarray(prior.sample(hyper_key))
        path = path_of(hyper)
        x = path.sample(path_key)
        near = jnp.abs(jnp.log(path_scale(x, path.steps))) < WINDOW / movement(path)
        luck = jnp.log(jax.random.uniform(luck_key))
        return near & (luck < log_ratio(path, x) - jnp.log(BOUND)), hyper, x

    def search(state: _Search) -> _Search:
        key, now = jax.random.split(state.key)
        kept, hypers, paths = jax.vmap(attempt)(jax.random.split(now, TRIED))
        first = jnp.argmax(kept)
        return _Search(key, kept[first], hypers[first], paths[first])

    hyper = jax.eval_shape(lambda: prior.sample(key))
    nothing = jnp.zeros(hyper.shape), jnp.zeros(path_of(jnp.ones(hyper.shape)).event_shape)
    start = _Search(key, jnp.zeros((), bool), *nothing)
    _, _, hyper, x = jax.lax.while_loop(lambda state: ~state.found, search, start)
    path = path_of(hyper)
    n = movement(path)
    log_scale = 1.0 + jax.random.normal(scale_key) / jnp.sqrt(n)
    return hyper, at_scale(x, path.steps, jnp.exp(log_scale))


def movement(path: GPDynamics) -> int:
    """Give n, the number of dimensions of a path's movement about the means of its clips."""
    rows, columns = path.event_shape
    return (rows - len(path.steps.first)) * columns


def log_ratio(path: GPDynamics, x: Float[Array, "n q"]) -> Array:
    """Give log g(., 0) - log g(., l) of a path x of log scale l."""
    n, log_scale = movement(path), jnp.log(path_scale(x, path.steps))
    whole = path.log_prob(x) + n * log_scale
    return path.log_prob(unit_scale(x, path.steps)) - whole
