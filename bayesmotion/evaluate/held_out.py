"""Leaving out whole clips, or all clips of a person, by fitting again without them.

Frames of a clip are alike, so what a model makes of new clips is told by clips left out. A
group g (a clip, a person) is scored by the log density that a fit to the others gives to its
recordings, log p(y_g | y_-g), their own unknowns integrated out (`inference.predicting`).
"""

import json
from collections.abc import Callable

import numpy as np
import xarray as xr
from arviz_stats.utils import ELPDDataLOO
from scipy.special import logsumexp

from ..errors import InputError
from ..fit import Fit
from ..inference.methods import METHODS, fit
from ..inference.predicting import DRAWS, predict
from .loo import elpd

Refit = Callable[[xr.Dataset], Fit]


def refit_of(trained: Fit) -> Refit:
    """Return a function that fits the same model to other recordings in the same way."""
    settings = json.loads(str(trained.tree.attrs["settings"]))
    method = METHODS[str(trained.tree.attrs["inference"])](**settings)
    seed = int(trained.tree.attrs["seed"])
    return lambda recordings: fit(trained.model, recordings, method=method, seed=seed)


def groups_of(recordings: xr.Dataset, by: str) -> dict[str, tuple[xr.Dataset, xr.Dataset]]:
    """Return for each group its recordings and all others.

    Parameters
    ----------
    recordings
        With a label `by` along frames, segments or points.
    by
        Name of the label, such as ``clip`` or ``subject``.

    Raises
    ------
    InputError
        If there is no such label, or a single group.
    """
    if by not in recordings.coords or recordings[by].ndim != 1:
        labels = [str(n) for n, c in recordings.coords.items() if c.ndim == 1 and n not in c.dims]
        raise InputError(
            f"by {by!r}", "the recordings have no such label", f"Use {', '.join(labels) or 'point'}"
        )
    label = recordings[by]
    names = list(dict.fromkeys(label.values.tolist()))
    if len(names) < 2:
        raise InputError(f"by {by!r}", f"there is one only, {names[0]!r}", "Leave points out")
    dim = label.dims[0]
    masks = {name: label.values == name for name in names}
    return {
        str(name): (recordings.isel({dim: mask}), recordings.isel({dim: ~mask}))
        for name, mask in masks.items()
    }


def leave_groups_out(
    trained: Fit, by: str, *, refit: Refit | None = None, draws: int = DRAWS, seed: int = 0
) -> ELPDDataLOO:
    """Score every group by a fit to all others.

    Parameters
    ----------
    trained
        A fit of any model.
    by
        Label whose groups are left out one at a time, such as ``clip`` or ``subject``.
    refit
        Fits the same model to other recordings; as the fit was made where None.
    draws
        At most so many draws of every fit.
    seed
        Of the search for the recordings' own unknowns.

    Returns
    -------
    One point a group, with the coordinate `by`.

    Raises
    ------
    InputError
        If there is no such label, or a single group.
    """
    refit = refit_of(trained) if refit is None else refit
    parts = groups_of(trained.motion, by)
    scores = []
    for held, others in parts.values():
        told = predict(refit(others), held, draws=draws, seed=seed).log_evidence
        scores.append(float(logsumexp(told) - np.log(len(told))))
    points = xr.DataArray(np.array(scores), {by: ("point", list(parts))}, ("point",))
    return elpd(points, n_samples=draws)
