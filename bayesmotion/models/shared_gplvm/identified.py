"""What data can tell of a shared latent model, and what it says of frames left out.

log_<view>_<part>   variance, linear, beta, and the sum of gamma over the coordinates
log_alpha           of the dynamics
distance_<view>     of frames spread over the clips, in the lengths of the view
"""

from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...errors import InputError
from ...gp.leave_out import leave_out_each, normal_log_density
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import Patterns
from ...model import Values
from .data import Views, evenly
from .processes import view_covariance, view_points

if TYPE_CHECKING:
    from .program import SharedGPLVM

SHOWN = 4  # frames
PARTS = ("variance", "linear", "gamma", "beta")


def quantities(model: "SharedGPLVM", frames: Views, values: Mapping[str, AnyArray]) -> Values:
    """Return the quantities of the module."""
    out: Values = {}
    first, second = _pairs(frames)
    if model.dynamics is not None:
        out["log_alpha"] = jnp.log(jnp.asarray(values["alpha"]))
    for name, points in _points(model, frames, values).items():
        for part in PARTS:
            out[f"log_{name}_{part}"] = jnp.log(jnp.sum(jnp.asarray(values[f"{name}_{part}"])))
        away = points["x"][first] - points["x"][second]
        out[f"distance_{name}"] = jnp.sqrt(jnp.sum(away**2, axis=1))
    return out


def left_out(
    model: "SharedGPLVM", frames: Views, values: Mapping[str, AnyArray]
) -> Float[Array, " n"]:
    """Return the log density of every kept frame given all others, views added up."""
    if not frames.exact:
        raise InputError(
            "inducing points", "they bound the density, which leaves no frame out",
            "Use a model without (inducing=None)",
        )  # fmt: skip
    total = jnp.zeros(len(frames.kept))
    for name, points in _points(model, frames, values).items():
        if model.back is not None and model.back.view == name:
            continue
        y, missing = frames.kept_of(name)
        K = view_covariance(name, values, points)
        mean, variance = leave_out_each(y, K, jnp.ones(y.shape[1]), missing)
        seen = _seen(missing)
        each = normal_log_density(jnp.where(seen, y, 0.0), mean, jnp.where(seen, variance, 1.0))
        total = total + jnp.sum(jnp.where(seen, each, 0.0), axis=1)
    return total


def dims(model: "SharedGPLVM") -> dict[str, tuple[str, ...]]:
    """Return the dimensions of the quantities."""
    found: dict[str, tuple[str, ...]] = {"log_alpha": ("alpha_part",)}
    for name in model.views:
        found |= {f"log_{name}_{part}": () for part in PARTS}
        found[f"distance_{name}"] = ("frame_pair",)
    return found


def coords(frames: Views) -> dict[str, list]:
    """Return the labels of pairs of frames."""
    first, second = _pairs(frames)
    return {"frame_pair": [f"{i}, {j}" for i, j in zip(first, second, strict=True)]}


def _points(
    model: "SharedGPLVM", frames: Views, values: Mapping[str, AnyArray]
) -> dict[str, dict[str, AnyArray]]:
    """Return every view's latent points of the kept frames, in its lengths."""
    private = {name: values[key] for name in model.views if (key := f"{name}_private") in values}
    if model.back is None:
        x = jnp.asarray(values["x"])
    else:
        x, own = model.mapped(frames.inputs[frames.kept], frames.centres, values)
        private |= own
    return {name: view_points(name, values, x, private) for name in model.views}


def _pairs(frames: Views) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and the second of all pairs of frames spread over the clips."""
    shown = evenly(len(frames.kept), SHOWN)
    first, second = zip(*combinations(shown.tolist(), 2), strict=True)
    return np.array(first), np.array(second)


def _seen(missing: Patterns) -> Bool[Array, "n d"]:
    rows, columns = jnp.asarray(missing.rows), jnp.asarray(missing.columns)
    return jnp.einsum("pn,pd->nd", rows, columns) > 0
