"""What a trained motion tensor says of combinations of levels, for every draw of a fit."""

from collections.abc import Mapping
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import Model
from .classes import class_log_density
from .data import NewSegments, TensorData, TensorTraining, new_segments


def level_log_densities(
    model: Model,
    training: TensorTraining,
    segments: xr.DataArray,
    values: Mapping[str, AnyArray],
) -> Float[Array, "s n c"]:
    """Return the log density of segments for every draw and combination of levels."""
    new = new_segments(segments, training).new
    draws = {name: jnp.asarray(value) for name, value in values.items()}
    return _log_densities(model, training.tensor, draws, new)


@partial(jax.jit, static_argnames="model")
def _log_densities(
    model: Model, tensor: TensorData, values: dict[str, Array], new: NewSegments
) -> Array:
    def one(draw: dict[str, Array]) -> Array:
        return class_log_density(model.condition(tensor, draw), new)

    return jnp.asarray(jax.lax.map(one, values))


def cell(
    model: Model,
    training: TensorTraining,
    levels: Mapping[str, str],
    values: Mapping[str, AnyArray],
) -> xr.DataArray:
    """Return the mean segment (channel, coefficient) of a combination of known levels.

    Raises
    ------
    InputError
        If a mode has no level, or one that is not known.
    """
    tensor = training.tensor
    row = np.ones(len(tensor.class_level), dtype=bool)
    for m, (mode, known) in enumerate(training.levels.items()):
        if levels.get(mode) not in known:
            raise InputError(
                f"{mode} {levels.get(mode)!r}", "the fit does not know it",
                f"Give one of {', '.join(known)}",
            )  # fmt: skip
        row &= np.asarray(tensor.class_level)[:, m] == known.index(levels[mode])
    draws = {name: jnp.asarray(value) for name, value in values.items()}
    each = _class_means(model, tensor, jnp.asarray(np.flatnonzero(row)[0]), draws)
    mean = np.sort(np.asarray(each), axis=0).mean(axis=0)
    like = training.segments[0]
    vector = training.position.vectors(mean[None])[0]
    return like.copy(data=vector.reshape(like.shape)).drop_vars("clip")


@partial(jax.jit, static_argnames="model")
def _class_means(model: Model, tensor: TensorData, row: Array, values: dict[str, Array]) -> Array:
    return jnp.asarray(jax.lax.map(lambda draw: model.condition(tensor, draw).mean[row], values))
