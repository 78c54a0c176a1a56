"""A small case of the keypose model for calibration: thirty minima of one dance."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import PRNGKeyArray

from ...gp.linalg import AnyArray
from ...model import SBCCase, Values, draw_sites, shuffled
from .data import KeyposeData

if TYPE_CHECKING:
    from .program import Keyposes

MINIMA = 30


def small_case(model: "Keyposes") -> tuple[SBCCase, KeyposeData]:
    """Return the case and its data: depths and offsets are fixed, answers are drawn."""
    random = np.random.default_rng(0)
    depths = random.normal(size=(2, MINIMA))
    data = KeyposeData(
        depths[0],
        depths[1],
        0.1 * random.normal(size=MINIMA),
        np.zeros((MINIMA, 1)),
        np.ones((MINIMA, 1), bool),
    )
    # The slope is the precision of the thresholds, by its logarithm.
    case = SBCCase(model, _draw, _shuffle, _quantities, "deep_global", (("log_slope", "log_odds"),))
    return case, data


def _draw(model: "Keyposes", key: PRNGKeyArray, data: KeyposeData) -> tuple[Values, KeyposeData]:
    values = draw_sites(model, key, data)
    return values, data._replace(keypose=values.pop("keypose").astype(float))


def _shuffle(key: PRNGKeyArray, data: KeyposeData) -> KeyposeData:
    """Put the answers in a random order, whatever the minima are."""
    return data._replace(keypose=shuffled(key, data.keypose, np.zeros(MINIMA, int)))


def _quantities(model: "Keyposes", data: KeyposeData, values: Mapping[str, AnyArray]) -> Values:
    return model.identified(data, values)
