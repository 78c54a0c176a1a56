"""Which of several fits of the same recordings predicts them best, and how sure that is.

Scores are log predictive densities of points left out (`loo`, `folds`). ArviZ compares
them: differences of their sums, standard errors, stacking weights (Yao et al. 2018).

Frames of a clip are alike, so a standard error over frames takes them for more evidence
than they are; beside it stands one over clips, with the clips' sums d_c of the pointwise
differences: sqrt(C / (C - 1) sum_c (d_c - mean)^2).
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from arviz_stats.loo import compare as compare_by_arviz
from arviz_stats.utils import ELPDData

from ..errors import InputError
from ..fit import Fit
from .held_out import leave_groups_out
from .loo import elpd_of_points

# Differences smaller than this are not worth telling apart (Sivula et al. 2025).
SMALL = 4.0
CLEAR = 2.0


@dataclass(frozen=True)
class Comparison:
    """Fits held against each other, best first.

    table
        As `az.compare` gives it, and ``dse_clips``: the standard error over clips.
    sentences
        What it says, and what to beware of.
    """

    table: pd.DataFrame
    sentences: tuple[str, ...]


def compare(fits: Mapping[str, Fit], by: str = "point", most: int | None = None) -> Comparison:
    """Compare fits of the same recordings by what they make of points or groups left out.

    Parameters
    ----------
    fits
        Name to fit, at least two.
    by
        ``point``: one frame, segment or other point at a time, by importance sampling. A
        label such as ``clip`` or ``subject``: one group at a time, by fitting again.
    most
        Use so many draws of each at most.

    Raises
    ------
    InputError
        If there are fewer than two, or they are not of the same data.
    """
    require_same_data(fits)
    if by != "point":
        return compare_scores({name: leave_groups_out(fit, by) for name, fit in fits.items()})
    found = compare_scores({name: elpd_of_points(fit, most) for name, fit in fits.items()})
    points = [name for name, fit in fits.items() if fit.point_estimate]
    if not points:
        return found
    named = ", ".join(points)
    told = (
        f"{named}: the parameters were estimated from all frames and are held; such scores "
        "are somewhat too high, the more so the more parameters there are."
    )
    return Comparison(found.table, (*found.sentences, told))


def require_same_data(fits: Mapping[str, Fit]) -> None:
    """Refuse fits that cannot be compared.

    Raises
    ------
    InputError
        If there are fewer than two, or their data differ.
    """
    if len(fits) < 2:
        raise InputError("compare", f"there is {len(fits)} fit", "Give at least two")
    (first, one), *others = fits.items()
    for name, other in others:
        if other.tree.attrs["data_hash"] != one.tree.attrs["data_hash"]:
            raise InputError(
                f"{first} and {name}",
                "they were fitted to different data, whose densities cannot be compared",
                "Fit both to the same clips, labels, frame rate and features",
            )


def compare_scores(scores: Mapping[str, ELPDData]) -> Comparison:
    """Compare scores of the same points.

    Parameters
    ----------
    scores
        Name to pointwise scores in ArviZ's format, at least two.

    Raises
    ------
    InputError
        If the points differ.
    """
    _require_same_points(scores)
    table = _arviz(scores)
    best = str(table.index[0])
    table["dse_clips"] = [_over_clips(scores[str(name)], scores[best]) for name in table.index]
    said = [_sentence(best, row) for row in numbers(table)[1:]]
    said += [text for name, score in scores.items() if (text := _k_hats(name, score))]
    return Comparison(table, tuple(said))


def _arviz(scores: Mapping[str, ELPDData]) -> pd.DataFrame:
    """Run `az.compare` on scores less the best at each point, and put these back.

    Differences and weights do not change; densities of hundreds of features at once
    would under- or overflow where weights are sought.
    """
    points = {name: np.asarray(score.elpd_i).ravel() for name, score in scores.items()}
    best = np.max(list(points.values()), axis=0)
    lowered = {}
    for name, score in scores.items():
        values = score.elpd_i - best.reshape(score.elpd_i.shape)
        kept = {key: value for key, value in vars(score).items() if key not in ("elpd", "elpd_i")}
        lowered[name] = type(score)(**kept, elpd=float(values.sum()), elpd_i=values)
    with warnings.catch_warnings():
        # It is told in sentences.
        warnings.filterwarnings("ignore", "Estimated shape parameter of Pareto", UserWarning)
        table = compare_by_arviz(lowered, round_to="none")
    table["elpd"] = [float(points[str(name)].sum()) for name in table.index]
    table["se"] = [float(scores[str(name)].se) for name in table.index]
    return table


def _require_same_points(scores: Mapping[str, ELPDData]) -> None:
    (first, one), *others = scores.items()
    for name, other in others:
        here, there = one.elpd_i, other.elpd_i
        same = here.shape == there.shape and all(
            np.array_equal(here[c].values, there[c].values)
            for c in here.coords
            if c in there.coords
        )
        if not same:
            raise InputError(
                f"{first} and {name}",
                f"they are scored on other points ({here.size} and {there.size})",
                "Leave the same out of both",
            )


def _over_clips(score: ELPDData, best: ELPDData) -> float:
    """Standard error of the difference of the sums, over clips; NaN for one clip."""
    difference = score.elpd_i - best.elpd_i
    if "clip" not in difference.coords:
        return float("nan")
    clip = difference["clip"].values
    sums = np.array([difference.values[clip == name].sum() for name in dict.fromkeys(clip)])
    return float(np.sqrt(len(sums) * np.var(sums, ddof=1))) if len(sums) > 1 else float("nan")


def numbers(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Give a comparison's rows, best first: the name of the ``fit`` and plain numbers."""
    columns = ("elpd", "elpd_diff", "dse", "dse_clips", "se", "weight")
    parts = {column: table[column].to_numpy(dtype=float).tolist() for column in columns}
    names = [str(name) for name in table.index]
    return [
        {"fit": name, **{column: part[i] for column, part in parts.items()}}
        for i, name in enumerate(names)
    ]


def _sentence(best: str, row: Mapping[str, Any]) -> str:
    """Tell how much worse one is than the best."""
    away = -row["elpd_diff"]
    error = float(np.nanmax([row["dse"], row["dse_clips"]]))
    text = f"{best} is ahead of {row['fit']} by {away:.1f}, with a standard error of {error:.1f}"
    if away < SMALL:
        return f"{text}: they predict alike."
    if away < CLEAR * error:
        return f"{text}: not clear which is better."
    return f"{text}: it predicts better."


def _k_hats(name: str, score: ELPDData) -> str:
    """Warn where importance sampling is not to be trusted."""
    if score.pareto_k is None or score.good_k is None:
        return ""
    high = int(np.sum(~(score.pareto_k.values <= score.good_k)))
    if not high:
        return ""
    return (
        f"{name}: Pareto k is above {score.good_k:.2f} at {high} of {score.n_data_points} points, "
        f"up to {float(score.pareto_k.max()):.2f}: their scores are not to be trusted; "
        "leave clips out instead."
    )
