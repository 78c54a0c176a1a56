"""The results of the GP-ODE boards as Markdown, drawn from their JSON file.

``python -m bayesmotion.studies.gpode.report docs/boards.md docs/results/gpode.json``
writes them into the page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ..boards.data import GPODE_SUBJECTS
from ..boards.harness import summary
from ..boards.tables import HEAD, error_cell, method_table, spread_cells
from ..cmu35.report import NAMES
from ..tables import table, write_results
from .study import PUBLISHED


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of what has been done."""
    parts = []
    for index, subject in enumerate(GPODE_SUBJECTS):
        test = result.get("test", {}).get(subject, {})
        rows = [(NAMES[name] + _halted(test[name]), test[name]) for name in NAMES if name in test]
        if rows:
            published = {name: (errors[index], None, source)
                         for name, (errors, source) in PUBLISHED.items()}  # fmt: skip
            parts.append(f"Subject {subject}:\n\n" + method_table(rows, published))
    if not parts:
        return ""
    told = (
        "Mean squared error in square degrees over all frames but the first and 50 channels, "
        "every test clip beside the mean; CRPS in degrees, log score in nats an entry, and how "
        "many of a hundred entries lie in their intervals, of the channels that move. Trained "
        "on training and validation clips. Of two clips the interval is their range."
    )
    return "\n\n".join([told, *parts, *_left_out(result)])


def _halted(one: Mapping[str, Any]) -> str:
    return "" if one.get("converged", True) else f" (not converged after {one['steps']} steps)"


def _left_out(result: Mapping[str, Any]) -> list[str]:
    rows = []
    for subject, chosen in result.get("chosen", {}).items():
        for size, views in result["left_out"][subject].items():
            for view, clips in views.items():
                bold = "**" if {"size": int(size), "view": view} == chosen else ""
                title = f"{bold}{subject}, {size} style dimensions, {view}{bold}"
                over = summary(clips)
                rows.append([title, error_cell(over), *spread_cells(over)])
    if not rows:
        return []
    folds = result["settings"]["folds"]
    told = (
        f"Training and validation clips left out in {folds} folds; the highest log score of a "
        "subject chose what is bold:\n\n"
    )
    return [told + table(["", "MSE (95 % over clips)", *HEAD], rows)]


if __name__ == "__main__":
    write_results("gpode", markdown, *sys.argv[1:])
