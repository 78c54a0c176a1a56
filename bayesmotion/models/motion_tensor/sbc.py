"""A small motion tensor for calibration: three people, two tasks, three repetitions of a cell."""

import itertools
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import PRNGKeyArray

from ...gp.linalg import AnyArray
from ...model import SBCCase, Values, draw_sites, shuffled
from .data import TensorData, tensor_data

if TYPE_CHECKING:
    from .program import MotionTensor

LEVELS, REPETITIONS, POSITIONS = (3, 2), 3, 2


def small_case(model: "MotionTensor") -> tuple[SBCCase, TensorData]:
    """Return the case and its data; further modes than two have two levels."""
    counts = (*LEVELS, *(2 for _ in model.modes[2:]))
    cells = np.array(list(itertools.product(*(range(count) for count in counts))))
    level = np.repeat(cells, REPETITIONS, axis=0)
    positions = POSITIONS if model.rank is None else min(POSITIONS, model.rank)
    data = tensor_data(np.zeros((len(level), positions)), level, counts)
    return SBCCase(
        model, _draw, _shuffle, _quantities, "log_odds", (("log_odds", "log_odds"),)
    ), data


def _draw(model: "MotionTensor", key: PRNGKeyArray, data: TensorData) -> tuple[Values, TensorData]:
    values = draw_sites(model, key, data)
    return values, data._replace(y=values.pop("y"))


def _shuffle(key: PRNGKeyArray, data: TensorData) -> TensorData:
    """Put all segments in a random order, whosever and whatever they are."""
    return data._replace(y=shuffled(key, data.y, np.zeros(len(data.y), int)))


def _quantities(model: "MotionTensor", data: TensorData, values: Mapping[str, AnyArray]) -> Values:
    return model.identified(data, values)
