"""What a calibration says: a p-value for every quantity, whether it holds, its power.

A model counts as miscalibrated when the smallest p-value, times the number of
quantities (Bonferroni), is below `LEVEL`: one in a hundred calibrations of a right
model is refused at most. What so many simulations would find of a fault is told by the
simulations with that fault: the share of their subsets in which the model is refused.
"""

import json
from dataclasses import dataclass
from html import escape
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Int

from ...errors import InputError
from .uniformity import p_value

LEVEL = 0.01
SUBSETS = 400


@dataclass(frozen=True, repr=False)
class RankTest:
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

    def __repr__(self) -> str:
        """Return the sentence and the p-values, smallest first."""
        rows = sorted(self.p.items(), key=lambda item: item[1])
        return "\n".join([self.sentence, *(f"  {name}: p = {p:.2g}" for name, p in rows)])

    def _repr_html_(self) -> str:
        """Return the same as notebooks show it."""
        rows = sorted(self.p.items(), key=lambda item: item[1])
        cells = "".join(f"<tr><td>{escape(n)}</td><td>{p:.2g}</td></tr>" for n, p in rows)
        return f"<p>{escape(self.sentence)}</p><table>{cells}</table>"


class Power(NamedTuple):
    """How often a fault is found.

    share
        Of subsets of the simulations in which the model is refused.
    error
        Standard error of it, at most: as if only disjoint subsets told anything.
    simulations
        In every subset.
    """

    share: float
    error: float
    simulations: int


def ranks_of(tree: xr.DataTree) -> dict[str, np.ndarray]:
    """Return the ranks (simulation,) of every scalar quantity, numbered where there are several."""
    out = {}
    for name, variable in tree["ranks"].data_vars.items():
        columns = variable.values[0].reshape(variable.sizes["draw"], -1).T
        single = len(columns) == 1
        out |= {str(name) if single else f"{name} {i + 1}": c for i, c in enumerate(columns)}
    return out


def levels_of(tree: xr.DataTree) -> int:
    """Return the number of values a rank can have."""
    return json.loads(tree.attrs["chains"])["draws"] + 1


def rank_test(tree: xr.DataTree) -> RankTest:
    """Test whether the ranks of a calibration are uniform.

    Parameters
    ----------
    tree
        From `calibration.calibrate`.
    """
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
    return RankTest(p, calibrated, count, f"{end}; {found}, {corrections}")


def power(tree: xr.DataTree, simulations: int, *, subsets: int = SUBSETS, seed: int = 0) -> Power:
    """Estimate how often the test refuses a model by so many simulations.

    Every random subset of the simulations, drawn without replacement, is what a calibration of
    that size might have been, so the mean over subsets has no bias; resampling with replacement
    would repeat ranks, which the test takes for a fault.

    Parameters
    ----------
    tree
        A calibration with at least so many simulations, the more the surer.
    simulations
        In every subset.
    subsets
        How many are drawn.
    seed
        Of the subsets.

    Raises
    ------
    InputError
        If the calibration has fewer.
    """
    levels = levels_of(tree)
    ranks = np.stack(list(ranks_of(tree).values()))
    total = ranks.shape[1]
    if simulations > total:
        raise InputError(
            f"power of {simulations} simulations", f"there are {total}", "Simulate more"
        )
    random = np.random.default_rng(seed)
    # The whole has one subset of its own size.
    count = subsets if simulations < total else 1
    chosen = [random.choice(total, simulations, replace=False) for _ in range(count)]
    share = float(np.mean([_refused(ranks[:, one], levels) for one in chosen]))
    error = float(np.sqrt(share * (1.0 - share) / max(total // simulations, 1)))
    return Power(share, error, simulations)


def _refused(ranks: Int[np.ndarray, "q n"], levels: int) -> bool:
    limit = LEVEL / len(ranks)
    return any(p_value(column, levels) < limit for column in ranks)


def summary(tree: xr.DataTree) -> dict[str, Any]:
    """Return a calibration as plain values, for a JSON file."""
    found = rank_test(tree)
    stats, kept = tree["sample_stats"].ds, json.loads(tree.attrs["chains"])
    iterations = kept["draws"] * kept["thin"]
    slow = [float(np.quantile(v, 0.9)) for v in tree["autocorrelation"].data_vars.values()]
    return {
        "control": tree.attrs["control"],
        "simulations": found.simulations,
        "calibrated": found.calibrated,
        "p_values": found.p,
        "simulations_with_divergences": int((stats["divergences"] > 0).sum()),
        "leapfrogs_per_iteration": float(stats["leapfrogs"].mean()) / iterations,
        "largest_autocorrelation": max(slow),
        "seconds": float(tree.attrs["seconds"]),
    }
