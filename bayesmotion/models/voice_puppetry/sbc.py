"""A small chain for simulation-based calibration: two clips of six frames.

The model is as it stands, with no more than two states.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ...gp.linalg import AnyArray
from ...model import NoiseMeaning, SBCCase, Values, draw_sites, shuffled
from .data import Frames
from .hidden_markov import row_patterns

if TYPE_CHECKING:
    from .program import VoicePuppetry

CLIPS, FRAMES, FEATURES, STATES = 2, 6, 2, 2


def case(model: "VoicePuppetry") -> tuple[SBCCase, Frames]:
    """Return the case of a model and its data, with zeros for features."""
    small = replace(model, states=min(model.states, STATES))
    precision: NoiseMeaning = "precision"
    noise: tuple[tuple[str, NoiseMeaning], ...] = tuple(
        (f"{name}_precision", precision) for name in model.outputs
    )
    n = CLIPS * FRAMES
    y = {name: np.zeros((n, FEATURES)) for name in model.outputs}
    rows = {name: row_patterns(np.ones((n, FEATURES), bool)) for name in y}
    frames = Frames(y, rows, np.arange(n) % FRAMES == 0)
    return SBCCase(small, _draw, _shuffle, _quantities, f"{model.face}_mean", noise), frames


def _draw(model: "VoicePuppetry", key: PRNGKeyArray, data: Frames) -> tuple[Values, Frames]:
    values = draw_sites(model, key, data)
    return values, data._replace(y={name: values.pop(name) for name in model.outputs})


def _shuffle(key: PRNGKeyArray, data: Frames) -> Frames:
    """Put the frames of the last output in another order than those of the others."""
    name = sorted(data.y)[0]
    clip = jnp.cumsum(jnp.asarray(data.begins))
    return data._replace(y={**data.y, name: shuffled(key, jnp.asarray(data.y[name]), clip)})


def _quantities(model: "VoicePuppetry", data: Frames, values: Mapping[str, AnyArray]) -> Values:
    found = model.identified(data, values)
    # The log likelihood is among what every calibration looks at.
    return {name: jnp.ravel(v) for name, v in found.items() if name != "log_likelihood"}
