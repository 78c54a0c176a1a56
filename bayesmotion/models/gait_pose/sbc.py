"""Small instances for simulation-based calibration: two gaits of five poses and five features."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ...gp.linalg import AnyArray
from ...model import SBCCase, Values, draw_sites, logs, shuffled
from .data import Cycles, make_cycles
from .hyperparameters import NAMES
from .settings import LatentSpace
from .surfaces import latent_start

POSES, GAITS, FEATURES = 5, 2, 5
WITHIN = 4
# Poses whose distances count, two of each gait.
SHOWN = (0, 1, 5, 7)


def small_cycles(surface: LatentSpace, scales: tuple[float, ...]) -> Cycles:
    """Return the arrays of the small data set, with zeros for features."""
    cycles = GAITS * len(scales)
    y = np.zeros((cycles * POSES, FEATURES))
    start = latent_start(surface, y, POSES, GAITS, scales, WITHIN)
    return make_cycles(y, [POSES] * cycles, start, surface)


def sbc_case(model: Any) -> SBCCase:
    """Return the calibration case of a model without dynamics."""
    return SBCCase(model, _draw, _shuffle, _quantities, "gamma", (("beta", "precision"),))


def _draw(model: Any, key: PRNGKeyArray, data: Cycles) -> tuple[Values, Cycles]:
    values = draw_sites(model, key, data)
    return values, replace(data, y=values.pop("y"))


def _shuffle(key: PRNGKeyArray, data: Cycles) -> Cycles:
    """Put all poses in a random order."""
    return replace(data, y=shuffled(key, data.y, np.zeros(len(data.y), int)))


def _quantities(model: Any, data: Cycles, values: Mapping[str, AnyArray]) -> Values:
    """Return hyperparameters, and sqrt(gamma) times the distances of some poses."""
    x = jnp.asarray(values["x"])[np.array(SHOWN)]
    first, second = np.triu_indices(len(SHOWN), 1)
    away = jnp.sqrt(jnp.sum((x[first] - x[second]) ** 2, axis=1))
    return {**logs(values, NAMES), "distance": jnp.sqrt(values["gamma"]) * away}
