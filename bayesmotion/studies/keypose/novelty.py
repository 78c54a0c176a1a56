"""Novelty on HDM05: persons and tasks never seen (the paper's Tables 4 and 5).

Every person and every task is left out in turn. Of the other levels the last repetition of
each cell is kept as known probes, the rest is for training; the probes of the level left out
are all its segments but the first repetitions. Channels and thresholds are chosen anew for
every level left out, on the training segments alone, which have nothing of it.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from ...errors import InputError
from ...models.motion_tensor.data import vectors
from ...motion.segments import Channels
from ...tasks.recognize import (
    FOLDS,
    Recognizer,
    best_levels,
    class_probabilities,
    repetition_folds,
)
from .models import Mask, first_repetitions, last_repetitions, train, trained_rule
from .scores import MODES, TITLES, interval
from .vectors import Vectors

CHANNELS: tuple[Channels, ...] = ("positions", "rotations", "both")
FALSE_ALARMS = 0.05  # aimed at on the training segments
INNER_FALSE_ALARMS = 0.1
INNER = 4  # levels left out of the training segments in turn
EPSILON = 0.05  # the paper's, for new tasks and new persons

Counts = dict[str, tuple[int, int]]


def leave_out(sets: Mapping[str, xr.DataArray], mode: str, level: str) -> dict[str, Any]:
    """Leave out one level: what both models call new, as pairs (how many, of how many).

    Parameters
    ----------
    sets
        Segments of the same clips, by channels.
    mode, level
        What is left out.
    """
    x = sets[CHANNELS[0]]
    last = last_repetitions(x) & np.any(repetition_folds(x, MODES), axis=0)
    away = x[mode].values == level
    masks = ~away & ~last, ~away & last, away & ~first_repetitions(x)
    channels = choose_channels({c: whole[masks[0]] for c, whole in sets.items()}, mode)
    return {
        "channels": channels,
        "tensor_bayes": bayes_calls(sets[channels], *masks, mode),
        "tensor_paper": paper_calls(sets[channels], *masks, mode),
        "positions_only": bayes_calls(sets["positions"], *masks, mode),
    }


def choose_channels(sets: Mapping[str, xr.DataArray], mode: str) -> Channels:
    """Choose channels by how well levels left out of the training are found.

    A level of the training segments is left out, of the others the last repetition too;
    the score is the share of the level's segments whose log odds of being new are above those
    of all but a tenth of the others' last repetitions.
    """
    scores = {}
    for channels, x in sets.items():
        last = last_repetitions(x) & np.any(repetition_folds(x, MODES), axis=0)
        whole, found = train(x), []
        for level in np.unique(x[mode].values)[:INNER]:
            away = x[mode].values == level
            part = train(x[~away & ~last], values=whole.values)
            odds = class_probabilities(part, x)[f"log_odds_{mode}"].values
            limit = np.quantile(odds[~away & last], 1.0 - INNER_FALSE_ALARMS)
            found.append(np.mean(odds[away] > limit))
        scores[channels] = float(np.mean(found))
    return cast("Channels", max(scores, key=lambda channels: scores[channels]))


def bayes_calls(x: xr.DataArray, trained: Mask, held: Mask, probes: Mask, mode: str) -> Counts:
    """Count what the Bayesian tensor calls new, and levels of the other mode named right."""
    tensor = train(x[trained])
    limit = thresholds(tensor, x[trained], FALSE_ALARMS)
    of_known, of_new = class_probabilities(tensor, x[held]), class_probabilities(tensor, x[probes])
    other = MODES[1 - MODES.index(mode)]
    right_new = np.array(best_levels(of_new, other)) == x[probes][other].values
    right_known = np.array(best_levels(of_known, other)) == x[held][other].values
    return {
        "found": (int(novel(of_new, limit)[mode].sum()), int(probes.sum())),
        "false_alarms": (int(novel(of_known, limit)[mode].sum()), int(held.sum())),
        "other_of_unseen": (int(right_new.sum()), int(probes.sum())),
        "other_of_known": (int(right_known.sum()), int(held.sum())),
    }


def novel(
    probabilities: xr.Dataset, thresholds: Mapping[str, float]
) -> dict[str, Bool[np.ndarray, " n"]]:
    """Tell for each mode which probes are of a level never seen: log odds above a threshold."""
    return {
        mode: probabilities[f"log_odds_{mode}"].values > threshold
        for mode, threshold in thresholds.items()
    }


def thresholds(
    recognizer: Recognizer, segments: xr.DataArray, false_alarms: float = 0.05
) -> dict[str, float]:
    """Choose from the training segments alone the log odds at which a level is called new.

    Parameters
    ----------
    recognizer
        Trained on `segments`; its site values are kept.
    segments
        The training segments.
    false_alarms
        Share of known segments that may be called new, every cell counting alike.

    Raises
    ------
    InputError
        If every cell has a single repetition.
    """
    folds = repetition_folds(segments, list(recognizer.levels), FOLDS)
    if not folds:
        raise InputError(
            "thresholds",
            "every combination of levels has a single repetition",
            "Give several repetitions of some, or a threshold",
        )
    new: dict[str, list[np.ndarray]] = {mode: [] for mode in recognizer.levels}
    cells: list[tuple] = []
    for held in folds:
        found = class_probabilities(recognizer.without(held), segments[held])
        labels = (segments[held][mode].values.tolist() for mode in recognizer.levels)
        cells += zip(*labels, strict=True)
        for mode, scores in new.items():
            scores.append(found[f"log_odds_{mode}"].values)
    # Every cell counts alike: one with many repetitions is known better than the others.
    counts = Counter(cells)
    weight = np.array([1.0 / counts[cell] for cell in cells])
    return {
        mode: _exceeded_by(np.concatenate(scores), weight, false_alarms)
        for mode, scores in new.items()
    }


def _exceeded_by(
    values: Float[np.ndarray, " n"], weight: Float[np.ndarray, " n"], share: float
) -> float:
    """Give the smallest of the values that at most a share of the weight exceeds."""
    order = np.argsort(values)[::-1]
    above = np.cumsum(weight[order]) - weight[order]
    return float(values[order][above <= share * weight.sum()][-1])


def paper_calls(x: xr.DataArray, trained: Mask, held: Mask, probes: Mask, mode: str) -> Counts:
    """Count the same for the paper's threshold rule (eq. 15 and 16)."""
    part, axis = x[trained], MODES.index(mode)
    rule, names = trained_rule(part, None)
    reached = np.zeros(len(names[axis]))
    for fold in repetition_folds(part, MODES, FOLDS):
        of_fold, _ = trained_rule(part[~fold], None)
        d = of_fold.distances(vectors(part[fold]), axis)
        own = np.array([names[axis].index(value) for value in part[fold][mode].values.tolist()])
        np.maximum.at(reached, own, d[np.arange(len(d)), own])

    def new(mask: Mask) -> int:
        d = rule.distances(vectors(x[mask]), axis)
        best = d.argmin(axis=1)
        return int((d.min(axis=1) > (1.0 + EPSILON) * reached[best]).sum())

    return {"found": (new(probes), int(probes.sum())), "false_alarms": (new(held), int(held.sum()))}


def novelty_plan() -> dict[str, Any]:
    """The settings of this part of the study."""
    return {
        "channels": list(CHANNELS),
        "false_alarms": [FALSE_ALARMS, INNER_FALSE_ALARMS],
        "inner": INNER,
        "epsilon": EPSILON,
    }


def pooled(parts: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Add up the levels left out of one mode; give shares with intervals."""
    result: dict[str, Any] = {"chosen": {level: row["channels"] for level, row in parts.items()}}
    for model in ("tensor_bayes", "tensor_paper", "positions_only"):
        rows = [row[model] for row in parts.values()]
        result[model] = {}
        for what in rows[0]:
            right, n = (sum(row[what][i] for row in rows) for i in (0, 1))
            result[model][what] = {"share": right / n, "n": n, "interval": interval(right, n)}
    return result


def stages(
    vectors: Callable[[], Vectors], coefficients: Callable[[], int]
) -> dict[str, Callable[[], dict[str, Any]]]:
    """Give a part for every level left out, each of which can run by itself.

    Parameters
    ----------
    vectors
        Gives the segments; called here for the names of the levels, and by the parts.
    coefficients
        Gives the number of coefficients that was chosen.
    """

    def run(mode: str, level: str) -> dict[str, Any]:
        return leave_out({c: vectors().of(c, coefficients()) for c in CHANNELS}, mode, level)

    return {
        f"unseen/new_{title}/{level}": lambda m=mode, v=str(level): run(m, v)
        for mode, title in TITLES.items()
        for level in np.unique(vectors().one[mode].values)
    }
