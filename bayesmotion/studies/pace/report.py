"""The results of the pace study as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.pace.report docs/boards.md docs/results/pace.json``
writes them into the page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ..boards.harness import summary
from ..tables import table, write_results

HEAD = ("error, rad", "CRPS", "log score", "50 %", "80 %", "90 %", "95 %")


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of what has been done."""
    parts = []
    if "chosen" in result:
        chosen = result["chosen"]
        told = (
            "Training people left out in turn, in the mean over their six clips; the highest log "
            "score chose what is bold:\n\n"
        )
        parts.append(told + _table(result["left_out"], chosen))
        if "test" in result:
            told = (
                "The eight test clips (error: mean norm over the 43 angles, ± its standard error "
                "over clips; CRPS in radians, log score in nats an angle, and the shares of "
                "angles in their intervals):\n\n"
            )
            parts.append(told + _table(result["test"], chosen))
    return "\n\n".join(parts)


def _table(found: Mapping[str, Any], chosen: str) -> str:
    rows = []
    for view, clips in found.items():
        over = summary(clips)
        error = f"{over['error']['mean']:.3f} ± {over['error']['se']:.3f}"
        shares = [f"{100 * over[f'coverage{share}']['mean']:.0f} %" for share in (50, 80, 90, 95)]
        title = f"**{view}**" if view == chosen else view
        crps, log_score = f"{over['crps']['mean']:.4f}", f"{over['log_score']['mean']:.2f}"
        rows.append([title, error, crps, log_score, *shares])
    return table(["", *HEAD], rows)


if __name__ == "__main__":
    write_results("pace", markdown, *sys.argv[1:])
