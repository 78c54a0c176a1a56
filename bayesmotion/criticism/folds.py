"""Leaving out what a user would want predicted: a limb of a clip, or a whole clip."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from arviz_stats.utils import ELPDDataLOO
from jaxtyping import Float
from scipy.special import logsumexp

from ..errors import InputError
from ..fit import Fit
from ..inference.draws import stacked
from ..motion.dataset import skeleton_of
from ..motion.joining import concat, split
from ..tasks.forecast import forecast, truth
from .blocks import (
    Blocks,
    Refit,
    block_densities,
    complete_frames,
    mean_density,
    result,
    without,
)
from .limbs import limb_features, limbs
from .loo import elpd


def leave_limbs_out(
    fit: Fit, refit: Refit, *, most: int | None = None, only: Sequence[str] | None = None
) -> ELPDDataLOO:
    """Score each limb of each clip, given the clip's other limbs and all other clips.

    Parameters
    ----------
    fit
        The fit.
    refit
        Fits the same model in the same way to other clips; called for a limb of a clip
        where importance sampling does not work.
    most
        Use so many draws at most.
    only
        Names of the limbs (their first joints); all where None.

    Returns
    -------
    One point a limb of a clip, its joint log density, with ``clip`` and ``limb``.

    Raises
    ------
    InputError
        If there is no such limb.
    """
    training, layout = fit.training, fit.training.encoding.layout
    known = limbs(skeleton_of(next(iter(split(fit.motion).values()))), layout)
    for name in only or ():
        if name not in known:
            raise InputError(f"limb {name!r}", "there is none", f"Use some of {', '.join(known)}")
    cases = [(clip, limb) for clip in training.clips for limb in (only or known)]
    clip_of = np.asarray(training.clips)[np.asarray(training.frames.clip)]
    rows = np.stack([clip_of == clip for clip, _ in cases]).astype(float)
    left = np.zeros((len(cases), len(layout.labels)))
    for case, (_, limb) in zip(left, cases, strict=True):
        case[limb_features(layout, known[limb])] = 1.0
    scored = left * (np.arange(left.shape[1]) < layout.n_angles)
    blocks = Blocks(rows, left, scored)

    def again(case: int) -> float:
        clip, limb = cases[case]
        other = refit(without_limb(fit.motion, clip, known[limb]))
        whole = complete_frames(other, fit.motion)
        here = Blocks(*(part[case : case + 1] for part in blocks))
        values, _ = stacked(other, most)
        return mean_density(block_densities(other, whole, values, here)[0][:, 0])

    values, shape = stacked(fit, most)
    count = shape[0] * shape[1]
    if count == 1:
        density, k_hat = np.array([again(case) for case in range(len(cases))]), np.zeros(len(cases))
    else:
        told, seen = block_densities(fit, training.frames, values, blocks)
        weights = without(seen, shape)
        density = np.asarray(logsumexp(told + weights.log, axis=0))
        k_hat = weights.k_hat.copy()
        for case in np.flatnonzero(~(k_hat <= weights.good_k)):
            density[case], k_hat[case] = again(int(case)), 0.0
    coords = {
        "clip": ("point", np.array([clip for clip, _ in cases])),
        "limb": ("point", np.array([limb for _, limb in cases])),
    }
    return result(density, k_hat, coords, count)


def leave_clips_out(
    fit: Fit, refit: Refit, *, lengths: Mapping[str, tuple[int, int]], max_steps: int = 400
) -> ELPDDataLOO:
    """Fit without each clip, and score its frames by a forecast from its first ones.

    The clip's own unknowns (its styles where no other clip has them, phase and step, or
    path) are estimated from the frames given, as for any new clip. They belong to the
    clip, so draws that have seen all of it are no draws without it, and every clip is
    left out by a fit of its own.

    Parameters
    ----------
    fit
        The fit.
    refit
        As in `leave_limbs_out`.
    lengths
        For each clip to leave out the numbers of frames given and predicted.
    max_steps
        Of the search for the clip's unknowns.

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
    for clip, (given, horizon) in lengths.items():
        if clip not in parts or len(parts) < 2 or parts[clip].sizes["frame"] < given + horizon:
            raise InputError(
                f"clip {clip!r}",
                f"it cannot be left out and predicted from frame {given} to {given + horizon}",
                "Name training clips that are long enough, of at least two",
            )
        others = concat([part for name, part in parts.items() if name != clip])
        scores.append(forecast_score(refit(others), parts[clip], given, horizon, max_steps))
    coords = {
        "clip": ("point", np.repeat(list(lengths), [len(score) for score in scores])),
        "frame": ("point", np.concatenate([g + np.arange(h) for g, h in lengths.values()])),
    }
    points = xr.DataArray(np.concatenate(scores), dims="point", coords=coords)
    return elpd(points, n_samples=fit.tree["posterior"].sizes["draw"])


def forecast_score(
    fit: Fit, clip: xr.Dataset, given: int, horizon: int, max_steps: int = 400
) -> Float[np.ndarray, " h"]:
    """Log density of each frame's angles (radians) under a clip's forecast."""
    predicted = forecast(fit, clip, given=given, horizon=horizon, max_steps=max_steps)
    true = truth(fit, clip, given, horizon)
    assert true is not None
    n = fit.training.encoding.n_angles
    ahead = predicted.mixture.part(slice(given, None), slice(n))
    return np.nansum(ahead.log_density(true[:, :n]), axis=1)


def without_limb(motion: xr.Dataset, clip: str, joints: tuple[str, ...]) -> xr.Dataset:
    """Give clips with the angles of some joints of one clip missing."""
    owner = np.array([str(dof).split("/")[0] for dof in motion["dof"].values])
    hidden = np.outer(motion["clip"].values == clip, np.isin(owner, joints))
    return motion.assign(angle=motion["angle"].where(~hidden))
