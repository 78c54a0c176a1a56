"""Which samples better, the scales of the outputs integrated out or sampled with the rest?"""

from typing import Any

import arviz as az
import numpy as np
import xarray as xr

from ...inference.sampling.nuts import fit_nuts
from ...models.multifactor import Multifactor

SETTINGS: dict[str, Any] = {"chains": 2, "warmup": 300, "draws": 300}
# Sites that are sampled either way.
SHARED = ("gamma", "step", "phase_point", "shape_subject", "shape_gait")
NOISE = ("beta", "residual_variance", "residual_time")


def both_ways(model: Multifactor, motion: xr.Dataset, seed: int) -> dict[str, dict[str, float]]:
    """Sample a model of content on a circle both ways.

    Parameters
    ----------
    model
        With an OU residual.
    motion
        Training clips.
    seed
        The one seed.

    Returns
    -------
    For ``integrated_out`` and ``sampled``: the least bulk ESS of the sites that both have
    and of the scales, seconds (search for the mode and compilation too), effective draws of
    the worst shared site a second, mean leapfrog steps of an iteration, the largest R-hat and
    the divergences.
    """
    ways = {"integrated_out": True, "sampled": False}
    return {name: _figures(model, motion, integrate, seed) for name, integrate in ways.items()}


def _figures(
    model: Multifactor, motion: xr.Dataset, integrate: bool, seed: int
) -> dict[str, float]:
    fit = fit_nuts(model, motion, seed=seed, integrate=integrate, **SETTINGS)
    posterior, stats = fit.tree["posterior"].ds, fit.tree["sample_stats"].ds
    shared = posterior[[*SHARED, *NOISE]]
    ess = min(float(v.min()) for v in az.ess(shared).data_vars.values())
    seconds = float(fit.tree.attrs["seconds"])
    return {
        "min_ess_bulk": ess,
        "min_ess_bulk_of_scales": float(az.ess(posterior[["scale"]])["scale"].min()),
        "seconds": seconds,
        "ess_a_second": ess / seconds,
        "leapfrogs": float(np.mean(stats["n_steps"])),
        "max_r_hat": max(float(v.max()) for v in az.rhat(shared).data_vars.values()),
        "divergences": int(stats["diverging"].sum()),
    }
