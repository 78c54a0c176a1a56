"""The study of gaps as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.gaps.report docs/gaps.md docs/results/gaps.json`` writes it into the
page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..tables import table, write_results
from .study import errors_of

NAMES = {
    "fill_gaps": "`bm.fill_gaps`",
    "principal_components": "principal components",
    "rigid": "rigid cluster of three, from the nearest frame (as MStudio)",
    "gapfill_rigid": "gapfill 0.0.7, rigid cluster of three",
    "gapfill_pattern": "gapfill 0.0.7, after one marker",
    "spline": "cubic spline",
}


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of what has been done."""
    if set(result.get("gaps", {})) != set(result["settings"]["recordings"]):
        return ""
    return "\n\n".join([_errors(result), _verdict(result), _coverage(result), _recordings(result)])


def _cells(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    settings = result["settings"]
    return [(f"{s:g}", f"{m}") for s in settings["seconds"] for m in settings["markers"]]


def _ways(result: Mapping[str, Any]) -> list[str]:
    first = result["settings"]["recordings"][0]
    known = result["gaps"][first]["0.5"]["1"]["rms_mm"]
    return [way for way in NAMES if way in known]


def _errors(result: Mapping[str, Any]) -> str:
    cells = _cells(result)
    rows = []
    for way in _ways(result):
        row = [NAMES[way]]
        for cell in cells:
            errors = errors_of(result, way, *cell)
            row.append(f"{errors.mean():.1f} ± {errors.std(ddof=1) / np.sqrt(len(errors)):.1f}")
        rows.append(row)
    count = len(errors_of(result, "fill_gaps", *cells[0]))
    head = ["", *(f"{seconds} s, {markers}" for seconds, markers in cells)]
    return (
        f"RMS error in millimetres, mean over {count} cut recordings and its standard error, by "
        "length of the gap and markers cut at the same time:\n\n" + table(head, rows)
    )


def _verdict(result: Mapping[str, Any]) -> str:
    cells, others = _cells(result), [way for way in _ways(result) if way != "fill_gaps"]
    worst = max(
        errors_of(result, "fill_gaps", *cell).mean()
        / min(errors_of(result, way, *cell).mean() for way in others)
        for cell in cells
    )
    seconds = np.mean([
        result["gaps"][name][s][m]["cpu_seconds"] / float(m)
        for name in result["gaps"] for s, m in cells
    ])  # fmt: skip
    told = "less than" if worst < 1.0 else "at most"
    return (
        f"In every column the error of `bm.fill_gaps` is {told} {worst:.2f} times that of the best "
        f"of the others. A gap takes {seconds:.1f} s of CPU."
    )


def _coverage(result: Mapping[str, Any]) -> str:
    rows = []
    for cell in _cells(result):
        row = [f"{cell[0]} s, {cell[1]}"]
        for share in result["settings"]["shares"]:
            kept = np.concatenate([
                result["gaps"][name][cell[0]][cell[1]]["coverage"][f"{share:g}"]
                for name in result["gaps"]
            ])  # fmt: skip
            error = kept.std(ddof=1) / np.sqrt(len(kept))
            row.append(f"{100 * kept.mean():.0f} ± {100 * error:.0f} %")
        rows.append(row)
    head = ["gap", *(f"{100 * share:g} %" for share in result["settings"]["shares"])]
    return "Share of the coordinates in their intervals:\n\n" + table(head, rows)


def _recordings(result: Mapping[str, Any]) -> str:
    rows = []
    for name, one in result["gaps"].items():
        for way in _ways(result):
            means = [float(np.mean(one[s][m]["rms_mm"][way])) for s, m in _cells(result)]
            rows.append([name, NAMES[way], *(f"{mean:.1f}" for mean in means)])
    head = ["recording", "", *(f"{s} s, {m}" for s, m in _cells(result))]
    return "Every recording, RMS error in millimetres:\n\n" + table(head, rows)


if __name__ == "__main__":
    write_results("gaps", markdown, *sys.argv[1:])
