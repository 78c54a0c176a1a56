"""The quantities of a model that data can tell, draw by draw.

R-hat and effective sample sizes mean something only for these: latent points may turn,
components may change places and phases may shift without changing what the model says, so
two chains can disagree on them and agree on everything that counts. Each model says itself
which they are (`Model.identified`); the log likelihood of the data is one for all.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array
from numpyro import handlers
from numpyro.distributions import Unit

from ..fit import Fit
from ..inference.draws import one_by_one, stacked, unstacked
from ..inference.predicting import require_model
from ..programs import one_at_a_time


@one_at_a_time
def identified(fit: Fit, most: int | None = None) -> xr.Dataset:
    """Return a fit's identified quantities.

    Parameters
    ----------
    fit
        Any fit.
    most
        At most so many draws, evenly spread; all where None.

    Returns
    -------
    One variable a quantity, with the dimensions chain, draw and others, all labelled, and
    ``log_likelihood``, log p(y | everything).
    """
    model = require_model(fit)
    values, shape = stacked(fit, most)
    computed = one_by_one(partial(_of_draw, model), dict(values), fit.training.data[0])
    dims, coords = {**model.dims(), "log_likelihood": ()}, model.coords(fit.training)
    labels = {"chain": np.arange(shape[0]), "draw": np.arange(shape[1])}
    used = {dim for name in computed for dim in dims[name]}
    return xr.Dataset(
        {
            name: (("chain", "draw", *dims[name]), unstacked(value, shape))
            for name, value in computed.items()
        },
        labels | {dim: coords[dim] for dim in sorted(used)},
    )


@partial(jax.jit, static_argnames="model")
def _of_draw(model: Any, draw: Mapping[str, Array], frames: Any) -> dict[str, Array]:
    found = dict(model.identified(frames, draw))
    return found | {"log_likelihood": _log_likelihood(model, frames, draw)}


def _log_likelihood(model: Any, frames: Any, draw: Mapping[str, Array]) -> Array:
    program = handlers.substitute(model.program, data=dict(draw))
    sites = handlers.trace(program).get_trace(frames).values()
    observed = [
        s
        for s in sites
        if s["type"] == "sample" and s["is_observed"] and not isinstance(s["fn"], Unit)
    ]
    return jnp.sum(jnp.stack([jnp.sum(s["fn"].log_prob(s["value"])) for s in observed]))
