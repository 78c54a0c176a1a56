"""Vectors by length and direction: coordinates in which their products lie straight.

What enters a product of linear factors, s^T s' g^T g', is told by the directions of s
and g and by the product of their lengths. So vectors that data know well lie about the
hyperbola |s| |g| = const, as thin as the data are many and as long as the priors allow:
the hardest of shapes for a sampler. By

    l = log |s|,    w = n_perp / (1 + n_1),    n = H s / |s|,

H the reflection that takes the centre c to the first axis, it is the straight line
l_s + l_g = const. w are the stereographic coordinates of the direction: 0 at c, of
length one at right angles to it, infinite at -c. The volume element is

    |ds / d(l, w)| = |s|^S (2 / (1 + |w|^2))^(S-1).

Where known vectors reach the first axes alone, only the length of what a new vector has on
the spare ones counts: there b and -b are alike. So the part on the spare axes has a length
and a direction of its own, and of a single spare axis the length is all.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..gp.linalg import AnyArray


def polar_of(
    vectors: Float[AnyArray, "l s"], centre: Float[AnyArray, " s"], spare: int = 0
) -> Float[Array, "l s"]:
    """Give (l, w) of vectors in R^S.

    Parameters
    ----------
    vectors
        None of them zero, or opposite to the centre; nor their part on the spare axes.
    centre
        Any vector but zero; only its direction counts.
    spare
        How many of the last axes are spare; no sign is told on a single one, nor on a single
        one of the others.
    """
    parts = zip(_split(vectors, spare), _centres(centre, spare), strict=True)
    return jnp.concatenate([_polar(part, middle) for part, middle in parts], axis=1)


def vectors_of(
    polar: Float[AnyArray, "l s"], centre: Float[AnyArray, " s"], spare: int = 0
) -> Float[Array, "l s"]:
    """Undo `polar_of`; a vector on a single spare axis is positive."""
    parts = zip(_split(polar, spare), _centres(centre, spare), strict=True)
    return jnp.concatenate([_vectors(part, middle) for part, middle in parts], axis=1)


def log_volume(polar: Float[AnyArray, "l s"], spare: int = 0) -> Float[Array, ""]:
    """Logarithm of the volume element, of all vectors together."""
    return sum((_log_volume(part) for part in _split(polar, spare)), jnp.zeros(()))


def _split(array: Float[AnyArray, "l s"], spare: int) -> list[Float[Array, "l _"]]:
    """Take the spare axes apart, where there are any."""
    array, reached = jnp.asarray(array), array.shape[1] - spare
    return [array] if spare == 0 else [array[:, :reached], array[:, reached:]]


def _centres(centre: Float[AnyArray, " s"], spare: int) -> list[Float[Array, " _"]]:
    """Give the centre of each part: on the spare axes any direction will do."""
    parts = [part[0] for part in _split(jnp.asarray(centre)[None], spare)]
    return parts[:1] + [jnp.asarray(np.eye(len(part))[0]) for part in parts[1:]]


def _polar(vectors: Float[Array, "l s"], centre: Float[Array, " s"]) -> Float[Array, "l s"]:
    turned = _reflected(vectors, centre)
    length = jnp.linalg.norm(turned, axis=1, keepdims=True)
    n = turned / length
    return jnp.concatenate([jnp.log(length), n[:, 1:] / (1.0 + n[:, :1])], axis=1)


def _vectors(polar: Float[Array, "l s"], centre: Float[Array, " s"]) -> Float[Array, "l s"]:
    log_length, w = polar[:, :1], polar[:, 1:]
    square = jnp.sum(w**2, axis=1, keepdims=True)
    n = jnp.concatenate([1.0 - square, 2.0 * w], axis=1) / (1.0 + square)
    return _reflected(jnp.exp(log_length) * n, centre)


def _log_volume(polar: Float[Array, "l s"]) -> Float[Array, ""]:
    size, w = polar.shape[1], polar[:, 1:]
    sphere = jnp.log(2.0) - jnp.log1p(jnp.sum(w**2, axis=1))
    return jnp.sum(size * polar[:, 0] + (size - 1) * sphere)


def _reflected(vectors: Float[Array, "l s"], centre: Float[AnyArray, " s"]) -> Float[Array, "l s"]:
    """Reflect so that the centre and the first axis change places; its own inverse."""
    centre = jnp.asarray(centre)
    along = centre / jnp.linalg.norm(centre)
    # Of the two reflections onto the axis, take the one without cancellation.
    sign = jnp.where(along[0] < 0.0, -1.0, 1.0)
    normal = along.at[0].add(sign)
    turned = vectors - 2.0 * jnp.outer(vectors @ normal, normal) / jnp.sum(normal**2)
    return -sign * turned
