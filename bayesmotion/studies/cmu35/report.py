"""The results of subject 35's board as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.cmu35.report docs/boards.md docs/results/cmu35.json``
writes them into the page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..boards.harness import summary
from ..boards.tables import HEAD, error_cell, method_table, spread_cells
from ..tables import table, write_results
from .study import PUBLISHED

NAMES = {
    "multifactor": "multifactor, circle with learned pace",
    "mixed": "cycles mixed, phase and period unknown",
    "cycle": "mean cycle, phase and period unknown",
    "nearest": "nearest stretch",
    "zero": "mean pose",
    "hold": "last pose",
}


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of what has been done."""
    test = result.get("test", {})
    done = [(pool, name) for name in NAMES for pool in test if name in test[pool]]
    if not done:
        return ""
    parts = [_test(result, done)]
    if "left_out" in result:
        parts.append(_left_out(result))
    return "\n\n".join(parts)


def _test(result: Mapping[str, Any], done: list[tuple[str, str]]) -> str:
    rows = [(f"{NAMES[name]}, {pool}{_halted(result, pool, name)}", result["test"][pool][name])
            for pool, name in done
            if name in ("multifactor", "mixed", "cycle") or pool == "19 clips"]  # fmt: skip
    told = (
        "Mean squared error in square degrees of the forecast's mean over 297 frames and 50 "
        "channels, every test clip beside the mean; CRPS in degrees, log score in nats an entry, "
        "and how many of a hundred entries lie in their intervals, of the 46 channels that move. "
        "19 clips: trained on training and validation clips; 16 clips: on the training clips "
        "alone. Others' numbers are as they published them, behind the sign their interval over "
        "sampled paths.\n\n"
    )
    return told + method_table(rows, PUBLISHED)


def _halted(result: Mapping[str, Any], pool: str, name: str) -> str:
    one = result["test"][pool][name]
    return "" if one.get("converged", True) else f" (not converged after {one['steps']} steps)"


def _left_out(result: Mapping[str, Any]) -> str:
    rows = []
    for size, views in result["left_out"].items():
        for view, clips in views.items():
            rows.append([f"multifactor, {size} style dimensions, {view}", *_over(clips)])
    for name, clips in result.get("baselines_left_out", {}).items():
        rows.append([f"{NAMES[name]}, each alone", *_over(clips)])
    folds = result["settings"]["folds"]
    told = (
        f"The same of the 19 training and validation clips, left out in {folds} folds (simple "
        "forecasts: each in turn). The median stands beside the mean: one clip takes 160 frames a "
        "cycle, where the others take 131 to 146.\n\n"
    )
    return told + table(["", "MSE (95 % over clips)", "median", *HEAD], rows)


def _over(clips: Mapping[str, Mapping[str, float]]) -> list[str]:
    over = summary(clips)
    median = float(np.median([one["mse"] for one in clips.values()]))
    return [error_cell(over), f"{median:.2f}", *spread_cells(over)]


if __name__ == "__main__":
    write_results("cmu35", markdown, *sys.argv[1:])
