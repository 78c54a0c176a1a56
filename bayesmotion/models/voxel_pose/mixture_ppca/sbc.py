"""A small mixture: sixteen points in the plane, two components of one direction each.

Components have no order and directions no sign. What counts of them is what is the same
in any order: the mixture's mean and covariance, and of the components' weights, noises
and areas the larger one and the smaller one.
"""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ....gp.linalg import AnyArray
from ....model import SBCCase, Values, draw_sites, shuffled
from .data import Points

POINTS, SIZE = 16, 2


def case(model: Any) -> tuple[SBCCase, Points]:
    """Return the small model's case, and its data."""
    # Location and scale are settings of the priors here, not those of the points drawn.
    data = Points(np.zeros((POINTS, SIZE)), np.zeros(SIZE), np.ones(()))
    return SBCCase(model, _draw, _shuffle, _quantities, "noise", (("noise", "variance"),)), data


def _draw(model: Any, key: PRNGKeyArray, data: Points) -> tuple[Values, Points]:
    values = draw_sites(model, key, data)
    return values, data._replace(t=values.pop("t"))


def _shuffle(key: PRNGKeyArray, data: Points) -> Points:
    """Put one coordinate in another order than the other; whole points have none to lose."""
    one = jnp.asarray(data.t)[:, :1]
    other = shuffled(key, jnp.asarray(data.t)[:, 1:], np.zeros(POINTS, int))
    return data._replace(t=jnp.concatenate([one, other], axis=1))


def _quantities(model: Any, data: Points, values: Mapping[str, AnyArray]) -> Values:
    """Return what is the same whatever the order of components."""
    mixture = model.condition(data, values)
    whole = model.identified(data, values)
    return {
        "log_weight": jnp.max(jnp.log(mixture.weight)),
        "log_noise": jnp.log(whole["sorted_noise"]),
        "log_area": jnp.sort(jnp.linalg.slogdet(mixture.covariances())[1]),
        "mean": whole["overall_mean"],
        "covariance": whole["overall_covariance"][jnp.tril_indices(SIZE)],
    }
