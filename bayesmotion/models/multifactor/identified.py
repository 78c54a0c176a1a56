"""What the data can tell of the multifactor model, draw by draw.

    gamma, beta, scale, residual_variance, residual_time, alpha    hyperparameters
    gram_<factor>       s_i^T s_j of a linear factor
    distance_<factor>   |s_i - s_j| of an rbf factor
    phase_direction     (cos, sin) of each clip's phase minus the first clip's
    step                radians a frame
    kernel              k between frames spread over the clips, without noise
    distance            sqrt(gamma) |x_t - x_t'| between them, for Gaussian process dynamics
    prediction          the noise-free outputs at them, on the data's first principal axes

and what each frame and entry is told by all others (`gp.leave_out`). See `program`
for the symbols.
"""

from collections.abc import Mapping
from itertools import combinations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...gp.leave_out import leave_out_each, normal_log_density
from ...gp.linalg import AnyArray
from .frames import Frames
from .program import MultifactorProgram
from .settings import Factor

FRAMES, AXES = 8, 3


def identified(
    model: MultifactorProgram, frames: Frames, values: Mapping[str, AnyArray]
) -> dict[str, Array]:
    """Return the identified quantities of one draw; see the module."""
    draw = {name: jnp.asarray(value) for name, value in values.items()}
    names = dict.fromkeys(("step", "residual_variance", "residual_time", *model.hyper_names))
    out = {name: draw[name] for name in names if name in draw}
    out |= _of_covariance(model, frames, draw) | _of_styles(model, draw)
    if "phase" in draw:
        away = (draw["phase"] - draw["phase"][:1])[1:]
        out["phase_direction"] = jnp.stack([jnp.cos(away), jnp.sin(away)], axis=-1)
    return out


def pointwise(
    model: MultifactorProgram, frames: Frames, values: Mapping[str, AnyArray]
) -> Float[Array, " n"]:
    """Return the log density (N,) of the seen entries of every frame given all other frames."""
    mean, variance = entries(model, frames, values)
    each = normal_log_density(jnp.asarray(frames.y), mean, variance)
    seen = jnp.einsum("pn,pd->nd", frames.missing.rows, frames.missing.columns)
    return jnp.sum(jnp.where(seen > 0, each, 0.0), axis=1)


def entries(
    model: MultifactorProgram, frames: Frames, values: Mapping[str, AnyArray]
) -> tuple[Float[Array, "n d"], Float[Array, "n d"]]:
    """Return mean and variance (N, D) of every entry given all others."""
    K = model.process(frames, values)
    return leave_out_each(jnp.asarray(frames.y), K, values["scale"], frames.missing)


def shown_frames(n: int) -> np.ndarray:
    """Return frames spread evenly over all clips, away from the ends."""
    count = min(FRAMES, n)
    return ((np.arange(count) + 0.5) * n / count).astype(int)


def pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and the second of all pairs of `count` things."""
    first, second = zip(*combinations(range(count), 2), strict=True)
    return np.array(first), np.array(second)


def _of_covariance(
    model: MultifactorProgram, frames: Frames, draw: Mapping[str, Array]
) -> dict[str, Array]:
    shown = shown_frames(len(frames.clip))
    first, second = pairs(len(shown))
    trained = model.condition(frames, draw)
    points = {name: jnp.asarray(point)[shown] for name, point in trained.points.items()}
    own = model.kernel(draw).matrix(points, points)
    mean, _ = model.outputs(trained, points, own)
    y = jnp.asarray(frames.y)
    axes = jnp.linalg.svd(y - jnp.mean(y, axis=0), full_matrices=False)[2][:AXES].T
    out = {"kernel": own[first, second], "prediction": mean @ axes}
    if not model.on_circle:
        away = points["content"][first] - points["content"][second]
        out["distance"] = jnp.sqrt(draw["gamma"] * jnp.sum(away**2, axis=1))
    return out


def _of_styles(model: MultifactorProgram, draw: Mapping[str, Array]) -> dict[str, Array]:
    """What counts of the style vectors: products, or distances."""
    out = {}
    for factor in model.style_factors:
        style = draw[f"style_{factor.name}"]
        if factor.kind == "linear":
            out[f"gram_{factor.name}"] = style @ style.T
        else:
            away = style[:, None] - style[None]
            out[f"distance_{factor.name}"] = jnp.sqrt(jnp.sum(away**2, axis=-1))
    return out


def dims_of(factors: tuple[Factor, ...]) -> dict[str, tuple[str, ...]]:
    """Return the dimensions of the identified quantities."""
    dims: dict[str, tuple[str, ...]] = {
        "kernel": ("frame_pair",),
        "distance": ("frame_pair",),
        "prediction": ("shown_frame", "principal_axis"),
        "phase_direction": ("moving_clip", "plane"),
    }
    for factor in factors:
        both = (f"level_{factor.name}", f"other_{factor.name}")
        dims |= {f"gram_{factor.name}": both, f"distance_{factor.name}": both}
    return dims


def coords_of(frames: Frames) -> dict[str, list]:
    """Return the labels of their dimensions."""
    numbers = [int(frame) for frame in shown_frames(len(frames.clip))]
    pair = [f"{numbers[i]}, {numbers[j]}" for i, j in zip(*pairs(len(numbers)), strict=True)]
    axes = min(AXES, *frames.y.shape)
    return {
        "frame_pair": pair,
        "shown_frame": numbers,
        "principal_axis": list(range(1, axes + 1)),
    }
