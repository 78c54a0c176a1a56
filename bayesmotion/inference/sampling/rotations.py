"""Rotations that no data can tell, taken out of what a sampler moves on.

Where points x (N, Q) enter a density only through distances and inner products, x R has
that of x for every orthogonal R. The posterior is a tube about an orbit that is bent:
straight steps leave it at once, however well the sampler knows the tube's thickness. So
of every orbit one point is taken (up to reflections), that turned towards a reference M,

    x^T M symmetric,

a plane through M at right angles to the orbit. With S = x^T M a turn by a small
antisymmetric A moves x^T M off the plane by S A + A S, so that by

    |det (A -> S A + A S)| = prod_(i<j) |s_i + s_j|,    s the eigenvalues of S,

the density on the plane counts each orbit by its volume.
"""

from collections.abc import Mapping
from itertools import combinations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...gp.linalg import AnyArray
from ..optimisation.optimise import flattened


def log_orbit_volume(
    x: Float[AnyArray, "n q"], reference: Float[AnyArray, "n q"]
) -> Float[Array, ""]:
    """Logarithm of the factor by which points of the plane count, up to a constant."""
    S = jnp.asarray(x).T @ jnp.asarray(reference)
    moved = [S @ A + A @ S for A in _antisymmetric(S.shape[0])]
    if not moved:
        return jnp.zeros(())  # points of one coordinate: there is nothing to turn
    row, column = _below(S.shape[0])
    return jnp.linalg.slogdet(jnp.stack([m[row, column] for m in moved]))[1]


def rotated_to(x: Float[np.ndarray, "n q"], reference: Float[np.ndarray, "n q"]) -> np.ndarray:
    """Turn (and reflect) points as near to the reference as they come: x^T M symmetric."""
    left, _, right = np.linalg.svd(x.T @ reference)
    return x @ left @ right


def rotation_directions(
    values: Mapping[str, AnyArray], names: tuple[str, ...]
) -> Float[np.ndarray, "n r"]:
    """Directions, orthonormal, in which all sites raveled (n,) move when one of these turns."""
    directions = []
    for name in names:
        for A in _antisymmetric(values[name].shape[1]):
            still = {other: np.zeros(value.shape) for other, value in values.items()}
            directions.append(flattened({**still, name: np.asarray(values[name]) @ A}))
    if not directions:
        return np.zeros((len(flattened(dict(values))), 0))
    return np.linalg.qr(np.stack(directions, axis=1))[0]


def orthogonal_complement(directions: Float[np.ndarray, "n r"]) -> Float[np.ndarray, "n m"]:
    """Orthonormal directions at right angles to those given, all there are."""
    n, r = directions.shape
    return np.eye(n) if r == 0 else np.linalg.svd(directions)[0][:, r:]


def _below(size: int) -> tuple[np.ndarray, np.ndarray]:
    pairs = np.array(list(combinations(range(size), 2)), dtype=int).reshape(-1, 2)
    return pairs[:, 1], pairs[:, 0]


def _antisymmetric(size: int) -> list[np.ndarray]:
    """Give a basis of the antisymmetric matrices, one a plane of rotation."""
    basis = []
    for row, column in zip(*_below(size), strict=True):
        A = np.zeros((size, size))
        A[row, column], A[column, row] = 1.0, -1.0
        basis.append(A)
    return basis
