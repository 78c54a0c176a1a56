"""Tables of boards: scores over clips with their uncertainty, as pages show them."""

from collections.abc import Mapping, Sequence
from typing import Any

from ..tables import table

SCORES = ("crps", "log_score", "coverage50", "coverage80", "coverage90", "coverage95")
HEAD = ("CRPS", "log score", "50 %", "80 %", "90 %", "95 %")


def spread_cells(over_clips: Mapping[str, Any]) -> list[str]:
    """Return CRPS, log score and coverages of a method, empty where only errors are known."""
    cells = []
    for name in SCORES:
        if name not in over_clips:
            cells.append("")
        elif name.startswith("coverage"):
            cells.append(f"{100 * over_clips[name]['mean']:.0f}")
        else:
            cells.append(f"{over_clips[name]['mean']:.2f}")
    return cells


def error_cell(over_clips: Mapping[str, Any], name: str = "mse") -> str:
    """Return a mean error and the 95 % interval of means of clips drawn again."""
    one = over_clips[name]
    low, high = one["interval"]
    return f"{one['mean']:.2f} ({low:.1f} to {high:.1f})"


def method_table(
    rows: Sequence[tuple[str, Mapping[str, Any]]], published: Mapping[str, tuple]
) -> str:
    """Return the table of methods scored here, every clip beside the mean, and others' numbers.

    Parameters
    ----------
    rows
        Title and result (``clips``, ``over_clips``) of each method.
    published
        Of each method of others its error, what stands behind the sign or None, and the source.
    """
    clips = list(rows[0][1]["clips"])
    lines = []
    for title, one in rows:
        each = [f"{one['clips'][clip]['mse']:.1f}" for clip in clips]
        over = one["over_clips"]
        lines.append([title, error_cell(over), *each, *spread_cells(over)])
    empty = [""] * (len(clips) + len(HEAD))
    for name, (error, sign, source) in published.items():
        told = f"{error:.2f}" if sign is None else f"{error:.2f} ± {sign:.2f}"
        lines.append([f"{name} ({source})", told, *empty])
    return table(["", "MSE (95 % over clips)", *clips, *HEAD], lines)
