"""Leaving out whole clips: each is forecast by a fit to the others."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from arviz_stats.utils import ELPDDataLOO
from jaxtyping import Float

from ...errors import InputError
from ...evaluate.loo import elpd
from ...fit import Fit
from ...motion.joining import concat, split
from ...tasks.forecast import angles_of, forecast
from .blocks import Refit


def leave_clips_out(
    fit: Fit, refit: Refit, *, lengths: Mapping[str, tuple[int, int]]
) -> ELPDDataLOO:
    """Fit without each clip, and score its frames by a forecast from its first ones.

    The clip's own unknowns (its styles where no other clip has them, phase and step, or
    path) are estimated from the context frames, as for any new clip. They belong to the
    clip, so draws that have seen all of it are no draws without it, and every clip is
    left out by a fit of its own.

    Parameters
    ----------
    fit
        The fit.
    refit
        Fits the same model in the same way to other clips.
    lengths
        For each clip to leave out the numbers of context frames and of those predicted.

    Returns
    -------
    One point a predicted frame: the sum over the angular features of the log predictive
    densities, in radians; with ``clip`` and ``frame`` (within the clip).

    Raises
    ------
    InputError
        If a clip is not there or too short, or is the only one.
    """
    parts = split(fit.motion)
    scores: list[np.ndarray] = []
    for clip, (context, horizon) in lengths.items():
        if clip not in parts or len(parts) < 2 or parts[clip].sizes["frame"] < context + horizon:
            raise InputError(
                f"clip {clip!r}",
                f"it cannot be left out and predicted from frame {context} to {context + horizon}",
                "Name training clips that are long enough, of at least two",
            )
        others = concat([part for name, part in parts.items() if name != clip])
        scores.append(forecast_score(refit(others), parts[clip], context, horizon))
    coords = {
        "clip": ("point", np.repeat(list(lengths), [len(score) for score in scores])),
        "frame": ("point", np.concatenate([g + np.arange(h) for g, h in lengths.values()])),
    }
    points = xr.DataArray(np.concatenate(scores), dims="point", coords=coords)
    return elpd(points, n_samples=fit.tree["posterior"].sizes["draw"])


def forecast_score(
    fit: Fit, clip: xr.Dataset, context: int, horizon: int
) -> Float[np.ndarray, " h"]:
    """Return the log density of each frame's angles (radians) under a clip's forecast."""
    predicted = forecast(fit, clip, context=context, horizon=horizon)
    true, columns = angles_of(fit, clip.isel(frame=slice(context + horizon)), context)
    ahead = predicted.mixture.part(slice(context, None), columns)
    return np.sum(ahead.log_density(true[context:]), axis=1)
