"""Questions people ask of gait, answered and checked: `bm.contrast` beside spm1d.

Data sets that come with spm1d are compared by both, in one run; in simulated designs (`designs`)
the share of simulations is told in which something false is said of any phase (family-wise error),
and in which the difference is found.
"""

from collections.abc import Mapping
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import xarray as xr

from ...motion.io.curves import axis_of
from ...tasks.contrast import Contrast, contrast
from ..stages import Say, Stages
from .designs import DESIGNS, Simulated, bump_phases, difference_of, simulated
from .spm import A, B, SubjectMeans, data_sets

REPETITIONS = 200


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict[str, Any]:
    """Compare, and write ``gait-questions.json``.

    Parameters
    ----------
    data
        Not used: the data sets come with spm1d.
    out
        Folder for the results.
    say
        Called with a line after every stage.
    seed
        Of the simulations.

    Raises
    ------
    InputError
        If spm1d is not installed.
    """
    stages = Stages(out / "gait-questions.json", plan(seed), say)
    for name, curves in data_sets().items():
        stages.read(**{name: curves.values})
        stages.do("sets", name, work=lambda c=curves: beside(c))
    for name, design in DESIGNS.items():
        stages.do("simulated", name, work=lambda d=design: simulations(d, seed))
    return stages.result


def plan(seed: int = 0) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "designs": {name: vars(design) for name, design in DESIGNS.items()},
        "repetitions": REPETITIONS, "seed": seed,
    }  # fmt: skip


def beside(curves: xr.DataArray) -> dict[str, Any]:
    """Return the regions of both, and by what they differ."""
    begun = process_time()
    found = contrast(curves, A, B)
    seconds = process_time() - begun
    theirs = SubjectMeans(curves)
    ours = _excludes_zero(found)
    along = curves[axis_of(curves)].values
    return {
        "paired": found.design.paired,
        "people": [int(n) for n in np.bincount(found.design.people.group)],
        "strides": int(found.design.strides.sum()),
        "ours": _regions(ours, along),
        "spm1d": _regions(theirs.significant(), along),
        "agree": float(np.mean(ours == theirs.significant())),
        "threshold": theirs.threshold,
        "band": float(np.median((found.band()[1] - found.mean) / found.sd)),
        "nu": found.difference.nu, "ratio": found.difference.ratio,
        "independent": found.difference.independent, "cpu_seconds": seconds,
        "narrower": float(np.median(found.sd / theirs.error)),
    }  # fmt: skip


def simulations(design: Simulated, seed: int) -> dict[str, Any]:
    """Return of every simulation whether each errs, and whether it finds the difference."""
    true, bump = difference_of(design), bump_phases()
    kept: dict[str, list[Any]] = {}
    for number in range(REPETITIONS):
        curves = simulated(design, np.random.default_rng([seed, number]))
        begun = process_time()
        found = contrast(curves, A, B, seed=number)
        low, high = found.band()
        seconds = process_time() - begun
        inside, theirs = found.interval(), SubjectMeans(curves)
        row = {
            "errs": bool(np.any((true < low) | (true > high))),
            "finds": bool(_excludes_zero(found)[bump].any()),
            "spm1d_errs": bool(theirs.significant(true).any()),
            "spm1d_finds": bool(theirs.significant()[bump].any()),
            "covered": float(np.mean((inside[0] <= true) & (true <= inside[1]))),
            "width": float(np.mean(high - low)),
            "cpu_seconds": seconds,
        }
        for name, value in row.items():
            kept.setdefault(name, []).append(value)
    return kept


def share(result: Mapping[str, Any], design: str, name: str) -> tuple[float, float]:
    """Return the share of a design's simulations that something is true of, and its error."""
    values = np.array(result["simulated"][design][name], dtype=float)
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))


def _excludes_zero(found: Contrast) -> np.ndarray:
    low, high = found.band()
    return (low > 0.0) | (high < 0.0)


def _regions(which: np.ndarray, along: np.ndarray) -> list[list[float]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], which.astype(int), [0]])))
    return [[float(along[a]), float(along[b - 1])] for a, b in edges.reshape(-1, 2)]
