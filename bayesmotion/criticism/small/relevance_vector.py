"""A small relevance vector machine: twelve points on a line, four basis functions, two outputs."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ...gp.linalg import AnyArray
from ...model import SBCCase, Values, draw_sites, logs, shuffled
from ...models.relevance_vector import Design, RelevanceVectors, basis_functions

POINTS, OUTPUTS = 12, 2
CENTRES = (-1.0, 0.0, 1.0)


def trial(kind: str) -> tuple[SBCCase, Design]:
    """Give the small model and its data."""
    assert kind == "relevance_vector"
    model = RelevanceVectors(length_scale=0.5)
    x = np.linspace(-1.5, 1.5, POINTS)[:, None]
    phi = basis_functions(x, np.array(CENTRES)[:, None], model.length_scale)
    data = Design(phi, np.zeros((POINTS, OUTPUTS)))
    return SBCCase(model, _draw, _shuffle, _quantities, "alpha", (("beta", "precision"),)), data


def _draw(model: RelevanceVectors, key: PRNGKeyArray, data: Design) -> tuple[Values, Design]:
    values = draw_sites(model, key, data)
    return values, data._replace(y=values.pop("y"))


def _shuffle(key: PRNGKeyArray, data: Design) -> Design:
    """Put all points in a random order: outputs that belong to other inputs."""
    return data._replace(y=shuffled(key, data.y, np.zeros(POINTS, int)))


def _quantities(model: RelevanceVectors, data: Design, values: Mapping[str, AnyArray]) -> Values:
    """Give precisions, and the outputs without their noise at every fourth point.

    In units of the noise: outputs are of very different sizes.
    """
    mean = jnp.asarray(data.phi) @ jnp.asarray(values["weight"])
    scaled = (mean * jnp.sqrt(values["beta"]))[::4]
    return {**logs(values, ("alpha", "beta")), "signal": scaled.ravel()}
