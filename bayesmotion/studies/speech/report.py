"""The speech study's results as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.speech.report docs/speech.md docs/results/speech.json``
writes them into the page's block.
"""

import sys
from typing import Any

from ..tables import table, write_results
from .faces_report import faces_markdown
from .figures import NAMES


def markdown(result: dict[str, Any]) -> str:
    """Give the tables of the parts that are there."""
    parts = (_recordings(result), faces_markdown(result, NAMES))
    return "\n\n".join(part for part in parts if part)


def _recordings(result: dict[str, Any]) -> str:
    """Give the tables of the sensors; nothing where no repeat is whole."""
    if not result.get("ema"):
        return ""
    head = [
        "", "error, mm", "lips, mm", "correlation", "lips' peak to peak", "90 % intervals hold",
        "training, s", "synthesis, s of a second",
    ]  # fmt: skip
    rows = [[NAMES[name], *_row(scores)] for name, scores in result["ema"].items()]
    count = f"{result['count']} repeats, mean ± standard deviation."
    differences = [
        [
            _pair(pair),
            f"{one['mean']:+.3f}",
            "{:+.3f} to {:+.3f}".format(*one["interval95"]) if "interval95" in one else "-",
        ]
        for pair, one in result["differences"].items()
    ]
    apart = table(["difference in error, mm", "mean", "95 % interval"], differences)
    return f"{count}\n\n{table(head, rows)}\n\n{apart}"


def _row(scores: dict[str, list[float]]) -> list[str]:
    def both(name: str, digits: int = 2) -> str:
        mean, sd = scores[name]
        return f"{mean:.{digits}f} ± {sd:.{digits}f}"

    covered = f"{100 * scores['coverage90'][0]:.0f} %" if "coverage90" in scores else ""
    return [
        both("rms_mm"), both("lips_rms_mm"), both("correlation", 3), both("lips_peak_to_peak"),
        covered, f"{scores['training_seconds'][0]:.0f}", f"{scores['seconds_per_second'][0]:.3f}",
    ]  # fmt: skip


def _pair(pair: str) -> str:
    first, second = pair.split(" - ")
    return f"{NAMES[first]} less {NAMES[second]}"


if __name__ == "__main__":
    write_results("speech", markdown, *sys.argv[1:])
