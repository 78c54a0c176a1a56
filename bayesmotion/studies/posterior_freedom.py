"""How far outputs of a new person stray, chosen by training people who are left out.

A trained model is sure of what its factors explain, and new people stray from that, each
output by its own amount (`Multifactor.freedom`). As in `multifactor_left_out` each training
subject's clips are forecast by a fit to the others; no test clip has a part in it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from ..criticism.scores import Mixture, score
from ..fit import Fit
from ..motion import concat, split
from ..tasks.forecast import forecast, truth
from .multifactor_left_out import lengths_of


def with_freedom(fit: Fit, freedom: float | None) -> Fit:
    """Give a fit whose new clips stray so; the training is the same."""
    return replace(fit, model=replace(fit.model, freedom=freedom))


def leave_subjects_out(
    motion: xr.Dataset, train: Callable[[xr.Dataset], Fit], freedoms: Sequence[float | None]
) -> dict[str, Any]:
    """Score forecasts of the clips of every subject by fits to the others.

    Parameters
    ----------
    motion
        The training clips.
    train
        Fits the model to clips.
    freedoms
        Degrees of freedom to try.

    Returns
    -------
    ``scores``, {freedom: mean of each figure over the clips}, and ``chosen``, the degrees
    of freedom of the highest log score.
    """
    parts = split(motion)
    subject = {clip: str(part["subject"].values[0]) for clip, part in parts.items()}
    found: dict[float | None, list[dict[str, float]]] = {freedom: [] for freedom in freedoms}
    for left in dict.fromkeys(subject.values()):
        fit = train(concat([part for clip, part in parts.items() if subject[clip] != left]))
        for freedom in freedoms:
            for clip in (clip for clip in parts if subject[clip] == left):
                found[freedom].append(_scores(with_freedom(fit, freedom), parts[clip]))
    means = {
        freedom: {name: float(np.mean([one[name] for one in each])) for name in each[0]}
        for freedom, each in found.items()
    }
    chosen = max(means, key=lambda freedom: means[freedom]["log_score"])
    return {"scores": {str(name): each for name, each in means.items()}, "chosen": chosen}


def _scores(fit: Fit, clip: xr.Dataset) -> dict[str, float]:
    given, horizon = lengths_of(clip)
    predicted = forecast(fit, clip, given=given, horizon=horizon)
    whole = Mixture(predicted.mean[None], predicted.sd[None], np.ones(1))
    n, true = fit.training.encoding.n_angles, truth(fit, clip, given, horizon)
    assert true is not None, "the lengths are those the clip has room for"
    return vars(score(whole.part(slice(given, None), slice(n)), true[:, :n]))
