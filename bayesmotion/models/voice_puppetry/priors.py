"""The priors of voice puppetry; their equations are in `program`."""

from typing import TYPE_CHECKING

import jax.numpy as jnp
from numpyro import distributions as dist

from .data import Frames
from .entropic import EntropicSimplex

if TYPE_CHECKING:
    from .program import VoicePuppetry

MEAN_SD = 1.5
STRENGTH = 6.0  # frames that the prior of a state's precision counts as


def site_priors(model: "VoicePuppetry", frames: Frames) -> dict[str, dist.Distribution]:
    """Return the priors of all sites, which are independent."""
    k = model.states
    found: dict[str, dist.Distribution] = {
        "initial": EntropicSimplex(k),
        "transition": EntropicSimplex(k).expand([k]).to_event(1),
    }
    for name in model.outputs:
        d = frames.y[name].shape[1]
        rate = STRENGTH * model.state_sd**2 * jnp.eye(d)
        precision = dist.Wishart(d + 1.0 + STRENGTH, rate_matrix=rate)
        found[f"{name}_precision"] = precision.expand([k]).to_event(1)
        found[f"{name}_mean"] = dist.Normal(0.0, MEAN_SD).expand([k, d]).to_event(2)
    return found
