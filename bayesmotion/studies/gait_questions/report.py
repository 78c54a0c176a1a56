"""The study of gait questions as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.gait_questions.report docs/gait-questions.md
docs/results/gait-questions.json`` writes it into the page's block.
"""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..tables import table, write_results
from .study import share

NOMINAL = 0.05


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of what has been done."""
    if not result.get("simulated"):
        return ""
    return "\n\n".join([_verdict(result), _simulated(result), _sets(result), _differences(result)])


def _verdict(result: Mapping[str, Any]) -> str:
    count = result["settings"]["repetitions"]
    most = NOMINAL + 2.0 * np.sqrt(NOMINAL * (1.0 - NOMINAL) / count)
    designs = list(result["simulated"])
    errs = {name: share(result, name, "errs")[0] for name in designs}
    over = [name for name in designs if errs[name] > most]
    less = [
        name for name in designs
        if share(result, name, "finds")[0] < share(result, name, "spm1d_finds")[0]
    ]  # fmt: skip
    held = "in no design" if not over else f"in {', '.join(over)}"
    found = "in none" if not less else f"in {', '.join(less)}"
    lacking = [name for name in result["settings"]["designs"] if name not in designs]
    still = f" Still to be simulated: {', '.join(lacking)}." if lacking else ""
    seconds = np.mean([result["simulated"][name]["cpu_seconds"] for name in designs])
    return (
        f"In {count} simulations of each of {len(designs)} designs the 95 % band of `bm.contrast` "
        f"errs at most in {100 * max(errs.values()):.1f} % of them; above 5 % and two standard "
        f"errors ({100 * most:.1f} %) it is {held}. It finds the difference less often than "
        f"spm1d's test on the means of people {found}. A contrast takes {seconds:.2f} s of "
        f"CPU.{still}"
    )


def _simulated(result: Mapping[str, Any]) -> str:
    head = ["design", "people", "strides of each", "false, `bm.contrast`", "false, spm1d",
            "found, `bm.contrast`", "found, spm1d", "in 95 % intervals"]  # fmt: skip
    rows = []
    for name in result["simulated"]:
        design = result["settings"]["designs"][name]
        strides = sorted(set(design["strides"]))
        between = f"{strides[0]}" if len(strides) == 1 else f"{strides[0]} to {strides[-1]}"
        cells = [
            _per_cent(share(result, name, column))
            for column in ("errs", "spm1d_errs", "finds", "spm1d_finds", "covered")
        ]
        rows.append([name, " + ".join(map(str, design["people"])), between, *cells])
    return (
        "Share of simulations in which something false is said of any phase, and in which the "
        "difference is found, with standard errors; and of phases whose 95 % interval holds the "
        "truth:\n\n" + table(head, rows)
    )


def _sets(result: Mapping[str, Any]) -> str:
    head = ["data set", "people", "curves", "`bm.contrast`", "spm1d", "phases that agree"]
    rows = [
        [
            name, " + ".join(map(str, one["people"])), str(one["strides"]), _told(one["ours"]),
            _told(one["spm1d"]), f"{100 * one['agree']:.0f} %",
        ]
        for name, one in result["sets"].items()
    ]  # fmt: skip
    return (
        "Where the data sets that come with spm1d differ, in per cent of the cycle. Of Dorn2012 "
        "the eight curves are of one runner: what is said holds of his steps, not of "
        "people:\n\n" + table(head, rows)
    )


def _differences(result: Mapping[str, Any]) -> str:
    head = ["data set", "spm1d's threshold", "half width of the band in sds", "sd / spm1d's error",
            "alike phases (ν)", "sd of the second group / first", "independent phases"]  # fmt: skip
    rows = []
    for name, one in result["sets"].items():
        if one["agree"] == 1.0:
            continue
        ratio = "–" if one["paired"] else f"{one['ratio']:.2f}"
        rows.append([
            name, f"{one['threshold']:.2f}", f"{one['band']:.2f}", f"{one['narrower']:.2f}",
            f"{one['nu']:.1f}", ratio, f"{one['independent']:.1f}",
        ])  # fmt: skip
    return (
        "Where the two disagree, why. A large ν says that people differ by as much at all phases: "
        "then the variance of a phase is known by the others too, the band is fewer sds wide than "
        "spm1d's threshold, and phases where people happen to agree closely are not taken at their "
        "word. Medians over phases:\n\n" + table(head, rows)
    )


def _per_cent(pair: tuple[float, float]) -> str:
    return f"{100 * pair[0]:.1f} ± {100 * pair[1]:.1f} %"


def _told(regions: Sequence[Sequence[float]]) -> str:
    return ", ".join(f"{start:.0f} to {end:.0f}" for start, end in regions) or "nowhere"


if __name__ == "__main__":
    write_results("gait-questions", markdown, *sys.argv[1:])
