"""A small mixture: sixteen points in the plane, two components of one direction each.

Components have no order and directions no sign. What counts of them is what is the same
in any order: the mixture's mean and covariance, and of the components' weights, noises
and areas the larger one and the smaller one.
"""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ...gp.linalg import AnyArray
from ...model import SBCCase, Values, draw_sites, shuffled
from ...models.mixture_ppca import MixturePPCA, Points

POINTS, SIZE = 16, 2


def trial(kind: str) -> tuple[SBCCase, Points]:
    """Give the small model and its data."""
    assert kind == "mixture_ppca"
    model = MixturePPCA(components=2, latent=1)
    # Middle and spread are settings of the priors here, not those of the points drawn.
    data = Points(np.zeros((POINTS, SIZE)), np.zeros(SIZE), np.ones(()))
    return SBCCase(model, _draw, _shuffle, _quantities, "noise", (("noise", "variance"),)), data


def _draw(model: MixturePPCA, key: PRNGKeyArray, data: Points) -> tuple[Values, Points]:
    values = draw_sites(model, key, data)
    return values, data._replace(t=values.pop("t"))


def _shuffle(key: PRNGKeyArray, data: Points) -> Points:
    """Put one coordinate in another order than the other; whole points have none to lose."""
    one = jnp.asarray(data.t)[:, :1]
    other = shuffled(key, jnp.asarray(data.t)[:, 1:], np.zeros(POINTS, int))
    return data._replace(t=jnp.concatenate([one, other], axis=1))


def _quantities(model: MixturePPCA, data: Points, values: Mapping[str, AnyArray]) -> Values:
    """Give what is the same whatever the order of components."""
    pi, mu, W, noise = (jnp.asarray(values[n]) for n in ("weight", "mean", "factor", "noise"))
    C = jnp.einsum("kdq,keq->kde", W, W) + noise[:, None, None] * jnp.eye(SIZE)
    mean = pi @ mu
    apart = mu - mean
    whole = jnp.einsum("k,kde->de", pi, C + jnp.einsum("kd,ke->kde", apart, apart))
    return {
        "log_weight": jnp.max(jnp.log(pi)),
        "log_noise": jnp.sort(jnp.log(noise)),
        "log_area": jnp.sort(jnp.linalg.slogdet(C)[1]),
        "middle": mean,
        "covariance": whole[jnp.tril_indices(SIZE)],
    }
