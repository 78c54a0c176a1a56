"""A small relevance vector machine: twelve points on a line, four basis functions, two outputs."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ....gp.linalg import AnyArray
from ....model import SBCCase, Values, draw_sites, logs, shuffled
from .data import Design, basis_functions

POINTS, OUTPUTS = 12, 2
CENTRES = (-1.0, 0.0, 1.0)
LENGTH_SCALE = 0.5


def case(model: Any) -> tuple[SBCCase, Design]:
    """Return the small model's case, and its data."""
    x = np.linspace(-1.5, 1.5, POINTS)[:, None]
    phi = basis_functions(x, np.array(CENTRES)[:, None], LENGTH_SCALE)
    data = Design(phi, np.zeros((POINTS, OUTPUTS)))
    return SBCCase(model, _draw, _shuffle, _quantities, "alpha", (("noise", "variance"),)), data


def _draw(model: Any, key: PRNGKeyArray, data: Design) -> tuple[Values, Design]:
    values = draw_sites(model, key, data)
    return values, data._replace(y=values.pop("y"))


def _shuffle(key: PRNGKeyArray, data: Design) -> Design:
    """Put all points in a random order: outputs that belong to other inputs."""
    return data._replace(y=shuffled(key, data.y, np.zeros(POINTS, int)))


def _quantities(model: Any, data: Design, values: Mapping[str, AnyArray]) -> Values:
    """Return precisions, and the outputs without their noise at every fourth point.

    In units of the noise: outputs are of very different sizes.
    """
    mean = jnp.asarray(data.phi) @ jnp.asarray(values["weight"])
    scaled = (mean / jnp.sqrt(values["noise"]))[::4]
    return {**logs(values, ("alpha", "noise")), "signal": scaled.ravel()}
