"""A small shared latent model: two views of eight frames, one of them with a private coordinate.

free
    Latent points free. Every frame holds an inducing point, so that the bound is the
    density.
constrained, dynamic
    Refused.
"""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import NoiseMeaning, SBCCase, Values, draw_sites, logs, shuffled
from ...models.multifactor_identified import pairs
from ...models.shared_gplvm import SharedGPLVM, view_points
from ...models.shared_views import Views
from ...priors.dynamics import steps_of

FRAMES, FEATURES, SHOWN = 8, 3, 4
VIEWS = ("sound", "face")
PARTS = ("variance", "linear", "gamma", "beta")


def trial(kind: str) -> tuple[SBCCase, Views]:
    """Give the small model of a kind and its data.

    Raises
    ------
    InputError
        If data cannot be drawn from it.
    """
    model = SharedGPLVM(
        VIEWS, latent_size=1, private=(0, 1), back="sound" if kind == "constrained" else "",
        relevance=False, dynamics=kind == "dynamic", inducing=FRAMES,
    )  # fmt: skip
    return shared_trial(model), small_views()


def small_views() -> Views:
    """Give frames of one clip, with zeros for features."""
    y = {name: np.zeros((FRAMES, FEATURES)) for name in VIEWS}
    every, none = np.arange(FRAMES), np.zeros((FRAMES, 0))
    clip = np.zeros(FRAMES, int)
    return Views(y, none, none, clip, steps_of([FRAMES]), every, every[:-1])


def shared_trial(model: SharedGPLVM) -> SBCCase:
    """Give the trial of a shared model.

    Raises
    ------
    InputError
        If data cannot be drawn from it.
    """
    if model.back:
        raise InputError(
            f"back-constraint on {model.back!r}",
            "its latent points are a function of the data themselves, so that no data can be "
            "drawn given them",
            "Use free latent points",
        )
    precision: NoiseMeaning = "precision"
    noise: tuple[tuple[str, NoiseMeaning], ...] = tuple(
        (f"{name}_beta", precision) for name in VIEWS
    )
    return SBCCase(model, _draw, _shuffle, _quantities, "face_gamma", noise)


def _draw(model: SharedGPLVM, key: PRNGKeyArray, data: Views) -> tuple[Values, Views]:
    values = draw_sites(model, key, data)
    return values, data._replace(y={name: values.pop(name) for name in VIEWS})


def _shuffle(key: PRNGKeyArray, data: Views) -> Views:
    """Put the frames of one view in another order than those of the other."""
    face = shuffled(key, data.y["face"], data.clip)
    return data._replace(y={**data.y, "face": face})


def _quantities(model: SharedGPLVM, data: Any, values: Mapping[str, AnyArray]) -> Values:
    """Give hyperparameters, and distances of frames in the lengths of the views."""
    out = logs(values, tuple(f"{name}_{part}" for name in VIEWS for part in PARTS))
    first, second = pairs(SHOWN)
    private = {"face": values["face_private"]}
    for name in VIEWS:
        x = view_points(name, values, values["x"], private)["x"][:: FRAMES // SHOWN]
        out[f"distance_{name}"] = jnp.sqrt(jnp.sum((x[first] - x[second]) ** 2, axis=1))
    return out
