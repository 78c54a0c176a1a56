"""The quantities of a model that data can tell, draw by draw.

R-hat and effective sample sizes mean something only for these: latent points may turn
and phases may shift without changing what the model says, so two chains can disagree
on them and agree on everything that counts.

For the multifactor model (see `models.multifactor` for the symbols):

    hyperparameters     gamma, beta, w_d, drift, drift_time, alpha
    gram_<factor>       s_i^T s_j of a linear factor
    distance_<factor>   |s_i - s_j| of an rbf factor
    phase_direction     (cos, sin) of each clip's phase minus the first clip's
    step                radians a frame
    kernel              k between frames spread over the clips, without noise
    distance            sqrt(gamma) |x_t - x_t'| between them, for Gaussian process dynamics
    prediction          the noise-free outputs at them, on the data's first principal axes
    log_likelihood      log p(Y | everything)
"""

from collections.abc import Callable, Mapping
from functools import partial
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from ..fit import Fit
from ..gp.linalg import AnyArray
from ..gp.matrix_normal import log_density
from ..inference.draws import stacked, unstacked
from ..models.factors import Factor
from ..models.multifactor import Multifactor
from ..models.poses import Frames

FRAMES, AXES = 8, 3


def identified(fit: Fit, most: int | None = None) -> xr.Dataset:
    """Give a fit's identified quantities.

    Parameters
    ----------
    fit
        Any fit.
    most
        At most so many draws, evenly spread; all where None.

    Returns
    -------
    One variable a quantity, with the dimensions chain, draw and others, all labelled.
    """
    return QUANTITIES[fit.model.name](fit, most)


def multifactor(fit: Fit, most: int | None = None) -> xr.Dataset:
    """Give the identified quantities of the multifactor model; see the module."""
    values, shape = stacked(fit, most)
    model, frames = fit.model, fit.training.frames
    shown = _spread(len(frames.clip))
    computed = _per_draw(model, frames, values, jnp.asarray(shown), _axes(frames))
    computed |= _of_styles(model, values)
    dims, coords = _labels(fit, shown)
    names = dict.fromkeys(("step", "drift", "drift_time", *model.hyper_names))
    computed |= {name: values[name] for name in names if name in values}
    if "phase" in values:
        away = (values["phase"] - values["phase"][:, :1])[:, 1:]
        computed["phase_direction"] = jnp.stack([jnp.cos(away), jnp.sin(away)], axis=-1)
    used = {dim for name in computed for dim in dims[name]}
    return xr.Dataset(
        {
            name: (("chain", "draw", *dims[name]), unstacked(value, shape))
            for name, value in computed.items()
        },
        {
            "chain": np.arange(shape[0]),
            "draw": np.arange(shape[1]),
            **{dim: coords[dim] for dim in sorted(used)},
        },
    )


QUANTITIES: Mapping[str, Callable[[Fit, int | None], xr.Dataset]] = {Multifactor.name: multifactor}


def _spread(n: int) -> np.ndarray:
    """Give frames spread evenly over all clips, away from the ends."""
    count = min(FRAMES, n)
    return ((np.arange(count) + 0.5) * n / count).astype(int)


def _axes(frames: Frames) -> Float[np.ndarray, "d a"]:
    """First principal axes of the training features."""
    y = np.asarray(frames.y)
    return np.linalg.svd(y - y.mean(axis=0), full_matrices=False)[2][:AXES].T


def pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Give the first and the second of all pairs of `count` things."""
    first, second = zip(*combinations(range(count), 2), strict=True)
    return np.array(first), np.array(second)


@partial(jax.jit, static_argnames="model")
def _per_draw(
    model: Multifactor,
    frames: Frames,
    values: Mapping[str, Array],
    shown: Array,
    axes: AnyArray,
) -> dict[str, Array]:
    """Work out what needs the covariance, draw by draw."""
    first, second = pairs(shown.shape[0])

    def one(draw: Mapping[str, Array]) -> dict[str, Array]:
        given = model.condition(frames, draw)
        points = {name: point[shown] for name, point in given.points.items()}
        kernel = model.kernel(draw)
        own = kernel.matrix(points, points)
        mean, _ = given.conditioned(kernel.matrix(points, given.points), own)
        K = model.covariance(frames, draw)
        y = jnp.asarray(frames.y)
        out = {
            "kernel": own[first, second],
            "prediction": mean @ axes,
            "log_likelihood": log_density(y, K, draw["scale"], frames.missing),
        }
        if model.dynamics != "circle":
            away = points["content"][first] - points["content"][second]
            out["distance"] = jnp.sqrt(draw["gamma"] * jnp.sum(away**2, axis=1))
        return out

    return jax.lax.map(one, dict(values))


def _of_styles(model: Multifactor, values: Mapping[str, Array]) -> dict[str, Array]:
    """What counts of the style vectors: products, or distances."""
    out = {}
    for factor in model.factors:
        style = values[f"style_{factor.name}"]
        if factor.kind == "linear":
            out[f"gram_{factor.name}"] = jnp.einsum("dls,dms->dlm", style, style)
        else:
            away = style[:, :, None] - style[:, None]
            out[f"distance_{factor.name}"] = jnp.sqrt(jnp.sum(away**2, axis=-1))
    return out


def _labels(fit: Fit, shown: np.ndarray) -> tuple[dict[str, tuple[str, ...]], dict[str, list]]:
    """Dimensions of the quantities and the labels along them."""
    model = fit.model
    coords = dict(model.coords(fit.training))
    first, second = pairs(len(shown))
    numbers = [int(frame) for frame in shown]
    coords |= {
        "frame_pair": [f"{numbers[i]}, {numbers[j]}" for i, j in zip(first, second, strict=True)],
        "shown_frame": numbers,
        "principal_axis": list(range(1, min(AXES, len(coords["feature"])) + 1)),
    }
    dims = dict(model.dims())
    dims |= {
        "kernel": ("frame_pair",),
        "distance": ("frame_pair",),
        "prediction": ("shown_frame", "principal_axis"),
        "log_likelihood": (),
        "phase_direction": ("moving_clip", "plane"),
    }
    for factor in model.factors:
        dims |= _style_dims(factor)
        coords[f"other_{factor.name}"] = coords[f"level_{factor.name}"]
    return dims, coords


def _style_dims(factor: Factor) -> dict[str, tuple[str, ...]]:
    both = (f"level_{factor.name}", f"other_{factor.name}")
    return {f"gram_{factor.name}": both, f"distance_{factor.name}": both}
