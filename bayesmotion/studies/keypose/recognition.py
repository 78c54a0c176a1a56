"""Recognition of persons and tasks on HDM05 (Perera, Kudoh and Ikeuchi, section 5.4).

Splits. The first repetition of every cell (person x task) is for training only, and the
vectors are chosen on these 55 segments alone, by leaving out one task and naming the
person, and leaving out one person and naming the task. All other segments are probes:

known                    trained on the first repetitions
known_all_repetitions    trained on all but one repetition of each cell, in turn

What identifies a person is told apart by `VARIANTS`: rotations and positions on one body
hold the constant posture of a recording too, part of which is how the skeleton was fitted to
the actor; positions alone, with bone lengths normalised, hold less of it; without the mean
pose nothing but movement is left.
"""

import functools
import itertools
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from ...motion.segments import Channels
from ...tasks.recognize import best_levels, class_probabilities, repetition_folds
from .models import MODELS, first_repetitions, one_probe_ms, predictions, train
from .scores import MODES, accuracies, calibration
from .vectors import Vectors

CHANNELS: tuple[Channels, ...] = ("positions", "rotations", "both")
COEFFICIENTS = (3, 6)
RANKS = (20, 40)  # of the position mode, beside all of it
VARIANTS: dict[str, dict[str, Any]] = {
    "rotations": {"channels": "rotations"},
    "positions": {"channels": "positions"},
    "positions_own_body": {"channels": "positions", "body": "own"},
    "movement_only": {"static": False},
}


def choose(vectors: Vectors) -> dict[str, Any]:
    """Choose channels and coefficients on the first repetitions alone.

    Returns
    -------
    The setting chosen, and a row for every candidate.
    """
    rows = []
    for channels in CHANNELS:
        for k in COEFFICIENTS:
            x = vectors.of(channels, k)
            x = x[first_repetitions(x)]
            rows.append({"channels": channels, "coefficients": k} | left_out(x))
    best = max(rows, key=lambda row: row["sum"])
    chosen = {"channels": best["channels"], "coefficients": best["coefficients"]}
    return {"chosen": chosen, "candidates": rows}


def left_out(x: xr.DataArray) -> dict[str, float]:
    """Give the share named right of persons in tasks left out and of tasks of persons left out."""
    whole = train(x)
    found: dict[str, float] = {}
    for away, mode in (MODES[::-1], MODES):
        right = []
        for level in np.unique(x[away].values):
            held = x[away].values == level
            part = train(x[~held], values=whole.values)
            named = best_levels(class_probabilities(part, x[held]), mode)
            right.append(np.array(named) == x[held][mode].values)
        found[mode] = float(np.concatenate(right).mean())
    return found | {"sum": found["subject"] + found["task"]}


def known(x: xr.DataArray, rank: int | None = None) -> dict[str, Any]:
    """One repetition a cell for training, all others probes.

    The labels of every probe are in ``named`` and ``true``, for the confusion matrices.
    """
    first = first_repetitions(x)
    named, probabilities, ms = predictions(x, first, ~first, rank)
    probes = x[~first]
    return accuracies(named, probes) | {
        "ms_per_probe": ms,
        "named": named["tensor_bayes"],
        "true": {mode: probes[mode].values.tolist() for mode in MODES},
        "calibration": {mode: calibration(probabilities, probes, mode) for mode in MODES},
    }


def known_all_repetitions(x: xr.DataArray) -> dict[str, Any]:
    """All repetitions but one of each cell for training, in turn; never the first one."""
    order, parts, tables = [], [], []
    for held in repetition_folds(x, MODES)[1:]:
        named, probabilities, _ = predictions(x, ~held, held, None)
        parts.append(named)
        tables.append(probabilities)
        order.append(np.flatnonzero(held))
    probes = x[np.concatenate(order)]
    joined = {
        model: {
            mode: functools.reduce(operator.iadd, (part[model][mode] for part in parts), [])
            for mode in MODES
        }
        for model in MODELS
    }
    whole = xr.Dataset(
        {name: xr.concat([t[name] for t in tables], dim="clip") for name in tables[0].data_vars}
    )
    return accuracies(joined, probes) | {
        "calibration": {mode: calibration(whole, probes, mode) for mode in MODES}
    }


def shares(found: dict[str, Any]) -> dict[str, Any]:
    """Keep accuracies, their intervals and the number of probes."""
    kept = ("n", "task", "task_interval", "person", "person_interval")
    return {name: found[name] for name in kept}


def stages(
    vectors: Callable[[], Vectors], chosen: Callable[[], dict[str, Any]]
) -> dict[str, Callable[[], dict[str, Any]]]:
    """Give the parts of recognition by name, each of which can run by itself.

    Parameters
    ----------
    vectors
        Gives the segments; called only by what needs them.
    chosen
        Gives the settings that `choose` found.
    """

    def vectors_of(**changes: Any) -> xr.DataArray:
        return vectors().of(**(chosen() | changes))

    def timed() -> dict[str, Any]:
        x = vectors_of()
        first = first_repetitions(x)
        return {"ms_one_probe": one_probe_ms(x, first, ~first)}

    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "choice": lambda: choose(vectors()),
        "known": lambda: known(vectors_of()) | timed(),
        "known_all_repetitions": lambda: known_all_repetitions(vectors_of()),
    }
    splits = {"known": known, "known_all_repetitions": known_all_repetitions}
    for (name, changes), (split, run) in itertools.product(VARIANTS.items(), splits.items()):
        parts[f"variants/{name}/{split}"] = lambda c=changes, r=run: shares(r(vectors_of(**c)))
    for rank in RANKS:
        parts[f"ranks/{rank}"] = lambda r=rank: shares(known(vectors_of(), r))
    return parts
