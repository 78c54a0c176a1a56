"""The results of the CMU actions' board as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.cmu_mm.report docs/boards.md docs/results/cmu-mm.json``
writes them into the page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ..tables import table, write_results
from .data import ACTIONS, FRAMES
from .study import PUBLISHED, horizons_won

NAMES = {
    "process": "Gaussian process of the context",
    "ridge": "ridge on the context",
    "nearest": "nearest stretch",
    "zero": "last pose",
}
SCORES = ("crps", "log_score", "coverage50", "coverage80", "coverage90", "coverage95")


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of what has been done."""
    done = [action for action in ACTIONS if "process" in result.get(action, {}).get("test", {})]
    if not done:
        return ""
    told = (
        "Mean distance of joints in millimetres, with the 95 % interval of blocks of windows drawn "
        "again. Those from others' papers are of networks trained on eight actions together."
    )
    return "\n\n".join([told, *(_action(result, action) for action in done), _spread(result, done)])


def _action(result: Mapping[str, Any], action: str) -> str:
    rows = []
    for name, title in NAMES.items():
        cells = []
        for ms in FRAMES:
            one = result[action]["test"][name][str(ms)]
            low, high = one["interval"]
            cells.append(f"{one['error_mm']:.1f} ({low:.1f} to {high:.1f})")
        rows.append([title, *cells])
    others = PUBLISHED.get(action, {})
    rows += [[name, *(f"{error:g}" for error in errors)] for name, errors in others.items()]
    text = f"{action.capitalize()}:\n\n" + table(["", *(f"{ms} ms" for ms in FRAMES)], rows)
    if others:
        won = horizons_won(result, action)
        text += f"\n\nThe process errs less than the ridge and GGMotion at {won} of 6 times."
    return text


def _spread(result: Mapping[str, Any], done: list[str]) -> str:
    rows = []
    for action in done:
        for ms in (80, 400, 1000):
            one = result[action]["test"]["process"][str(ms)]
            cells = [f"{one['crps']:.2f}", f"{one['log_score']:.2f}"]
            cells += [f"{100 * one[name]:.0f}" for name in SCORES[2:]]
            rows.append([action, f"{ms} ms", *cells])
    told = (
        "Spread of the process, coordinate by coordinate: CRPS in millimetres, log score in nats, "
        "and how many of a hundred coordinates lie in their intervals:\n\n"
    )
    head = ["action", "", "CRPS", "log score", "50 %", "80 %", "90 %", "95 %"]
    return told + table(head, rows)


if __name__ == "__main__":
    write_results("cmu-mm", markdown, *sys.argv[1:])
