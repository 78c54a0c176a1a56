"""Log densities of single points of the training data, as leave-one-out asks for them.

For every draw theta a point (a frame with all its features, a segment, a clip) has the
density p(y_i | y_-i, theta) given all other points (`Model.pointwise`). Where points are
independent given theta their logarithms add up to the log likelihood; under a Gaussian
process they do not.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array

from ..gp.linalg import AnyArray
from ..model import Model, ProgramData
from .draws import one_by_one

SAMPLE = ("chain", "draw")


def pointwise_log_likelihood(
    model: Model, data: ProgramData, values: Mapping[str, AnyArray], shape: tuple[int, int]
) -> xr.Dataset:
    """Return ``log p(y_i | y_-i, theta)`` of every point that was seen, as the variable ``y``.

    Parameters
    ----------
    model
        The model.
    data
        The training data.
    values
        Draws of all sites (S, ...), chain after chain.
    shape
        Numbers of chains and of draws in each.

    Returns
    -------
    ``y`` (chain, draw, point), with coordinates that say what a point is: ``frame``,
    ``clip``, ... (`Model.points`).
    """
    density = one_by_one(partial(_points, model), dict(values), data.data[0])
    density = density.reshape(*shape, density.shape[1])
    # A point of which nothing was seen says nothing, whatever the draw.
    seen = np.any(density != 0.0, axis=(0, 1))
    coords = {name: (dim, np.asarray(value)[seen]) for name, (dim, value) in
              model.points(data).items()}  # fmt: skip
    return xr.Dataset({"y": ((*SAMPLE, "point"), density[:, :, seen])}, coords)


@partial(jax.jit, static_argnames="model")
def _points(model: Any, draw: Mapping[str, Array], frames: Any) -> Array:
    """Log density (N,) of every point given all others."""
    return model.pointwise(frames, draw)
