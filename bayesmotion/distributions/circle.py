"""Phases: angles that are sampled as points of the plane.

A phase theta = atan2(z_2, z_1) is uniform when the direction of z is; the length of
z says nothing and is kept near one,

    p(z) = LogNormal(|z|; 0, TIGHT) / (2 pi |z|),

so that a sampler goes around the circle without meeting an end of it, and hardly
sees that the points are not on the circle itself.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ..gp.linalg import AnyArray

TIGHT = 0.1
LOG_2PI = float(np.log(2.0 * np.pi))


def circle(angle: Float[AnyArray, " n"]) -> Float[Array, "n 2"]:
    """Give the points of the unit circle at these angles."""
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)


def angle_of(points: Float[AnyArray, "n 2"]) -> Float[Array, " n"]:
    """Give the directions of points of the plane, in radians from -pi to pi."""
    points = jnp.asarray(points)
    return jnp.arctan2(points[:, 1], points[:, 0])


class Ring(dist.Distribution):
    """Distribution of `count` independent points (count, 2) in all directions, about one away."""

    arg_constraints: ClassVar = {}
    support = constraints.independent(constraints.real, 2)  # pyright: ignore
    pytree_aux_fields = ("count",)

    def __init__(self, count: int, *, validate_args=None):
        self.count = count
        super().__init__(batch_shape=(), event_shape=(count, 2), validate_args=False)

    def log_prob(self, value):
        """Log density of the points `value` (count, 2)."""
        length = jnp.sqrt(jnp.sum(value**2, axis=-1))
        # A log-normal length, written by its logarithm: NumPyro's own has no density of none.
        log = jnp.log(length)
        radial = dist.Normal(0.0, TIGHT).log_prob(log) - 2.0 * log - LOG_2PI
        return jnp.sum(radial, axis=-1)

    def sample(self, key=None, sample_shape=()):
        """Draw points."""
        assert key is not None, "a draw needs a key"
        direction, length = jax.random.split(key)
        shape = (*sample_shape, self.count)
        angle = jax.random.uniform(direction, shape, minval=-jnp.pi, maxval=jnp.pi)
        radius = jnp.exp(TIGHT * jax.random.normal(length, shape))
        return radius[..., None] * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
