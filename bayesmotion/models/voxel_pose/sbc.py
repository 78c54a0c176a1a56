"""A small instance: two components in the plane, eight frames of three descriptors each.

The frames' descriptors are given; drawn are the sample that the mixture explains, and the poses.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ...gp.linalg import AnyArray
from ...model import SBCCase, Values, draw_sites, logs, shuffled
from .data import Frames
from .mixture_ppca.data import Points

FRAMES, EACH, SIZE, OUTPUTS = 8, 3, 2, 2


def case(model: Any) -> tuple[SBCCase, Frames]:
    """Return the small model's case, and its data."""
    random = np.random.default_rng(0)
    count = FRAMES * EACH
    descriptors = 1.5 * random.standard_normal((count, SIZE))
    points = Points(np.zeros((count, SIZE)), np.zeros(SIZE), np.ones(()))
    frame = np.repeat(np.arange(FRAMES), EACH)
    centres = np.arange(0, FRAMES, 3)
    data = Frames(descriptors, frame, np.zeros((FRAMES, OUTPUTS)), points, centres)
    small = replace(model, components=2, latent=1)
    return SBCCase(small, _draw, _shuffle, _quantities, "alpha", (("noise", "variance"),)), data


def _draw(model: Any, key: PRNGKeyArray, data: Frames) -> tuple[Values, Frames]:
    values = draw_sites(model, key, data)
    assert data.points is not None
    points = data.points._replace(t=values.pop("descriptor"))
    return values, data._replace(pose=values.pop("pose"), points=points)


def _shuffle(key: PRNGKeyArray, data: Frames) -> Frames:
    """Put the poses in a random order: they belong to other frames."""
    return data._replace(pose=shuffled(key, data.pose, np.zeros(FRAMES, int)))


def _quantities(model: Any, data: Frames, values: Mapping[str, AnyArray]) -> Values:
    """Return precisions, length, and signals in units of the noise; of the mixture its order."""
    whole = model.identified(data, values)
    scaled = whole["signal"] / jnp.sqrt(values["noise"])
    return {
        **logs(values, ("alpha", "noise", "length")),
        "signal": scaled[::4].ravel(),
        "mixture_log_likelihood": whole["mixture_log_likelihood"],
        "log_weight": jnp.log(whole["sorted_weight"][-1]),
        "log_component_noise": jnp.log(whole["sorted_noise"]),
    }
