"""What a calibration says: a p-value for every quantity, a verdict, a summary.

A model counts as miscalibrated when the smallest p-value, times the number of
quantities (Bonferroni), is below `LEVEL`: one in a hundred calibrations of a right
model is refused at most.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from .calibration import calibrate
from .controls import CONTROLS, Control
from .small import small_trial
from .uniformity import p_value

LEVEL = 0.01
# The model and the kind of what is calibrated in the study of posteriors.
STUDIED: dict[str, tuple[str, str]] = {
    "circle_white": ("multifactor", "circle_white"),
    "circle_own_drift": ("multifactor", "circle_own_drift"),
    "gp_second": ("multifactor", "gp_second"),
    "gp_first": ("multifactor", "gp_first"),
    "tensor": ("tensor", "tensor"),
    "relevance_vector": ("relevance_vector", "relevance_vector"),
    "mixture_ppca": ("mixture_ppca", "mixture_ppca"),
    "shared_gplvm": ("shared_gplvm", "shared_gplvm"),
    "voice_puppetry": ("voice_puppetry", "voice_puppetry"),
    "gait_pose_torus": ("gait-pose", "torus"),
    "gait_pose_on_torus": ("gait-pose", "on_torus"),
}


@dataclass(frozen=True)
class Verdict:
    """Whether ranks are uniform.

    p
        p-value of every quantity, by name.
    calibrated
        Whether all are uniform as far as can be told.
    simulations
        How many ranks each p-value is from.
    sentence
        The same in words.
    """

    p: dict[str, float]
    calibrated: bool
    simulations: int
    sentence: str


def ranks_of(tree: xr.DataTree) -> dict[str, np.ndarray]:
    """Give the ranks (simulation,) of every scalar quantity, numbered where there are several."""
    out = {}
    for name, variable in tree["ranks"].data_vars.items():
        columns = variable.values[0].reshape(variable.sizes["draw"], -1).T
        single = len(columns) == 1
        out |= {str(name) if single else f"{name} {i + 1}": c for i, c in enumerate(columns)}
    return out


def levels_of(tree: xr.DataTree) -> int:
    """Give the number of values a rank can have."""
    return json.loads(tree.attrs["chains"])["draws"] + 1


def verdict(tree: xr.DataTree) -> Verdict:
    """Test every quantity of a calibration and say what follows."""
    levels, ranks = levels_of(tree), ranks_of(tree)
    p = {name: p_value(column, levels) for name, column in ranks.items()}
    worst = min(p, key=lambda name: p[name])
    corrected = min(1.0, p[worst] * len(p))
    calibrated = corrected >= LEVEL
    count = len(ranks[worst])
    found = f"the smallest of {len(p)} p-values, of {worst}, is {p[worst]:.2g}"
    corrections = f"{corrected:.2g} when corrected for their number"
    end = (
        f"calibrated as far as {count} simulations tell"
        if calibrated
        else f"miscalibrated: the ranks of {count} simulations are not uniform"
    )
    return Verdict(p, calibrated, count, f"{end}; {found}, {corrections}")


def summary(tree: xr.DataTree) -> dict[str, Any]:
    """Give a calibration as plain values, for a JSON file."""
    said = verdict(tree)
    stats, kept = tree["sample_stats"].ds, json.loads(tree.attrs["chains"])
    iterations = kept["draws"] * kept["thin"]
    slow = [float(np.quantile(v, 0.9)) for v in tree["autocorrelation"].data_vars.values()]
    return {
        "control": tree.attrs["control"],
        "simulations": said.simulations,
        "calibrated": said.calibrated,
        "p_values": said.p,
        "simulations_with_divergences": int((stats["divergences"] > 0).sum()),
        "leapfrogs_per_iteration": float(stats["leapfrogs"].mean()) / iterations,
        "largest_autocorrelation": max(slow),
        "seconds": float(tree.attrs["seconds"]),
    }


def study(simulations: int, seed: int, note: Callable[[str], None]) -> dict[str, dict[str, Any]]:
    """Calibrate the small versions of all models, and run every control on each.

    Parameters
    ----------
    simulations
        Of each calibration.
    seed
        Of everything.
    note
        Is told what has been found.

    Returns
    -------
    For each of `STUDIED` its `summary` and ``controls`` with those of the controls, each
    with ``caught``.
    """
    out = {}
    for name, (model, kind) in STUDIED.items():
        found = {}
        trial, data = small_trial(model, kind)
        every: tuple[Control, ...] = ("none", *CONTROLS)
        for control in every:
            tree = calibrate(trial, data, simulations=simulations, seed=seed, control=control)
            found[control] = summary(tree)
            note(f"{name}, control {control}: {verdict(tree).sentence}")
        out[name] = {**found.pop("none"), "controls": _caught(found)}
    return out


def _caught(found: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Say of each control whether it was caught."""
    return {name: {"caught": not one["calibrated"], **one} for name, one in found.items()}
