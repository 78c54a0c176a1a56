"""A small shared model for simulation-based calibration: its views of eight frames.

The model is as it stands, with no more than two shared coordinates.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ...distributions.dynamics import steps_of
from ...errors import InputError
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import complete
from ...model import NoiseMeaning, SBCCase, Values, draw_sites, shuffled
from .data import Views

if TYPE_CHECKING:
    from .program import SharedGPLVM

FRAMES, FEATURES, LATENT = 8, 3, 2


def case(model: "SharedGPLVM") -> tuple[SBCCase, Views]:
    """Return the case of a model and its data, with zeros for features."""
    if model.back is not None:
        raise InputError(
            f"back-constraint on {model.back.view!r}",
            "its latent points are a function of the data themselves, so that no data can be "
            "drawn given them",
            "Use free latent points (back=None)",
        )
    if model.inducing is not None and model.inducing.above < FRAMES:
        raise InputError(
            "inducing points", "a bound has no normaliser to draw by", "Use inducing=None"
        )
    small = replace(model, latent_size=min(model.latent_size, LATENT), every=1)
    precision: NoiseMeaning = "precision"
    noise: tuple[tuple[str, NoiseMeaning], ...] = tuple(
        (f"{name}_beta", precision) for name in model.views
    )
    prior = f"{model.views[-1]}_gamma"
    return SBCCase(small, _draw, _shuffle, _quantities, prior, noise), views_of(model)


def views_of(model: "SharedGPLVM", frames: int = FRAMES) -> Views:
    """Return frames of one clip."""
    y = {name: np.zeros((frames, FEATURES)) for name in model.views}
    missing = {name: complete(frames, FEATURES) for name in model.views}
    every, none = np.arange(frames), np.zeros((frames, 0))
    return Views(
        y, missing, none, none[:0], every, np.zeros(frames, int), steps_of([frames]),
        every[:0], every[:0],
    )  # fmt: skip


def _draw(model: "SharedGPLVM", key: PRNGKeyArray, data: Views) -> tuple[Values, Views]:
    values = draw_sites(model, key, data)
    return values, data._replace(y={name: values.pop(name) for name in model.views})


def _shuffle(key: PRNGKeyArray, data: Views) -> Views:
    """Put the frames of one view in another order than those of the others."""
    name = sorted(data.y)[-1]
    other = shuffled(key, jnp.asarray(data.y[name]), data.clip)
    return data._replace(y={**data.y, name: other})


def _quantities(model: "SharedGPLVM", data: Views, values: Mapping[str, AnyArray]) -> Values:
    return model.identified(data, values)
