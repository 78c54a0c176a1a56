"""What the data can tell of a draw, and how likely each pose is given the others.

variance, beta   of the kernel and the noise
gamma            where latent points lie on the surface, whose size is known; else
                 gamma is as large as points are close together
distance         sqrt(gamma) |x_i - x_j| of poses spread over all cycles
kernel           k(x_i, x_j) between them, without noise
log_likelihood   log p(Y | everything)
"""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...gp.leave_out import leave_out_rows
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import log_density
from .data import Cycles, GaitData
from .hyperparameters import covariance, pose_kernel

SHOWN = 8
DIMS: dict[str, tuple[str, ...]] = {
    "kernel": ("pose_pair",),
    "distance": ("pose_pair",),
    "log_likelihood": (),
}


def pairs(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of the first and the second pose of all pairs of `SHOWN` out of n poses."""
    count = min(SHOWN, n)
    shown = ((np.arange(count) + 0.5) * n / count).astype(int)
    first, second = np.triu_indices(count, 1)
    return shown[first], shown[second]


def pair_labels(n: int) -> dict[str, list]:
    """Return the labels of those pairs."""
    return {"pose_pair": [f"{i}, {j}" for i, j in zip(*pairs(n), strict=True)]}


def identified(frames: Cycles, values: Mapping[str, AnyArray], *, gamma: bool) -> dict[str, Array]:
    """Return the quantities of one draw, `gamma` among them or not."""
    x = jnp.asarray(values["x"])
    n, d = frames.y.shape
    first, second = pairs(n)
    square = jnp.sum((x[first] - x[second]) ** 2, axis=1)
    near = pose_kernel(values).matrix({"x": x}, {"x": x})
    likelihood = log_density(frames.y, covariance(values, x), jnp.ones(d), frames.missing)
    names = ("variance", "beta", "alpha", *(("gamma",) if gamma else ()))
    return {
        **{name: jnp.asarray(values[name]) for name in names if name in values},
        "kernel": near[first, second],
        "distance": jnp.sqrt(values["gamma"] * square),
        "log_likelihood": likelihood,
    }


def pointwise(frames: Cycles, values: Mapping[str, AnyArray], layers: int) -> Float[Array, " m"]:
    """Return the log density of every recorded pose given all others, for one draw.

    Its copies at other scales are left out with it.
    """
    n, d = frames.y.shape
    blocks = np.arange(n).reshape(layers, n // layers).T
    K = covariance(values, jnp.asarray(values["x"]))
    left = leave_out_rows(frames.y, K, jnp.ones(d), frames.missing, blocks)
    return jnp.sum(left, axis=1)


def points(data: GaitData) -> dict[str, tuple[str, np.ndarray]]:
    """Return clip and pose of every recorded pose."""
    _, gait, pose = data.index()[: len(data.gaits) * data.poses].T
    return {"clip": ("point", np.asarray(data.gaits)[gait]), "pose": ("point", pose)}
