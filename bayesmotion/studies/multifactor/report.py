"""The multifactor study's results as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.multifactor.report README.md docs/results/multifactor.json``
writes them into the page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ..tables import table, write_results

NAMES = {
    "gpdm": "GPDM",
    "gpdm_style": "stylistic GPDM",
    "bgpdm": "B-GPDM",
    "bgpdm_style": "stylistic B-GPDM",
    "cdm_style": "stylistic circle",
    "cdm_style_own": "the same, each clip's own residuals",
    "cdm_style_white": "the same, white noise",
    "cdm_style_default": "the same, default settings, at the mode",
    "hold": "hold the pose",
    "constant_velocity": "constant velocity",
    "nearest": "nearest stretch",
}


def markdown(result: Mapping[str, Any]) -> str:
    """Give the tables, ours with the paper's in brackets."""
    parts = [_long(result)]
    if "table2" in result:
        parts.append(_short(result))
    if "left_out" in result:
        parts.append(_left_out(result["left_out"]))
    if "defaults" in result:
        parts.append(_defaults(result["defaults"]))
    halted = [NAMES[name] for name, converged in result["converged"].items() if not converged]
    if halted:
        steps = max(result["steps"].values())
        parts.append(f"Not converged after {steps} steps: {', '.join(halted)}.")
    seconds, peak = result["seconds"], result["peak_memory_gb"]
    parts.append(
        f"Training the stylistic circle model took {seconds['training']['cdm_style']:.0f} s with "
        f"compilation and {seconds['training_compiled']['cdm_style']:.0f} s without, all of the "
        f"first table {seconds['table1']:.0f} s, at most {peak:.1f} GB."
    )
    return "\n\n".join(parts)


def _long(result: Mapping[str, Any]) -> str:
    """Table 1 as means over the clips and clip by clip."""
    clips = list(result["table1"])
    told = (
        "Long prediction: mean error in radians (norm over the 43 angles) over the frames "
        "predicted; the paper's number in brackets.\n\n"
    )
    rows = []
    for name, mean in result["means"].items():
        cells = [_with_paper(mean, result["paper"]["means"].get(name))]
        for clip in clips:
            cells.append(
                _with_paper(result["table1"][clip][name], result["paper"]["table1"][clip].get(name))
            )
        covers = [row[name] for row in result["coverage90"].values() if name in row]
        cells.append(f"{100 * sum(covers) / len(covers):.0f} %" if covers else "")
        rows.append([NAMES[name], *cells])
    return told + table(["model", "mean", *clips, "90 % intervals cover"], rows)


def _short(result: Mapping[str, Any]) -> str:
    """Table 2: mean and standard error over the first frames drawn."""
    told = (
        "Short prediction (10 frames given, 20 predicted, 24 first frames drawn at random): mean "
        "and standard error.\n\n"
    )
    clips, rows = list(result["table2"]), []
    for name in result["table2"][clips[0]]:
        cells = []
        for clip in clips:
            mean, error = result["table2"][clip][name]
            theirs, theirs_error = result["paper"]["table2"][clip][name]
            cells.append(f"{mean:.2f} ± {error:.3f} ({theirs:.2f} ± {theirs_error:.3f})")
        rows.append([NAMES[name], *cells])
    return told + table(["model", *clips], rows)


def _left_out(found: Mapping[str, Any]) -> str:
    """What the training clips say of the circle model's noise."""
    told = (
        "Training clips, each subject's forecast by a fit to the other subjects' (what the noise "
        "of the circle model was chosen by):\n\n"
    )
    rows = []
    for name, mean in found["means"].items():
        covers = [row[name] for row in found["coverage90"].values()]
        cover = f"{100 * sum(covers) / len(covers):.0f} %"
        rows.append([NAMES[name], f"{mean:.2f}", cover])
    return told + table(["model", "mean error", "90 % intervals cover"], rows)


def _defaults(found: Mapping[str, Any]) -> str:
    """What the training clips say of the settings."""
    told = (
        "The same of all combinations of settings for new people; the highest log score chooses "
        "the defaults:\n\n"
    )
    names = [
        *("residuals", "novel dimensions", "degrees of freedom"),
        *("error", "CRPS", "log score", "cover"),
    ]
    sizes = {False: "one size", True: "each clip's own"}
    rows = []
    for row in found["tried"]:
        chosen = " (chosen)" if row == found["chosen"] else ""
        df = "infinite" if row["student_df"] is None else f"{row['student_df']:.0f}"
        cells = [sizes[row["per_clip"]] + chosen, str(row["novel_dims"]), df]
        cells += [f"{row['error']:.2f}"]
        cells += [f"{row['crps']:.4f}", f"{row['log_score']:.2f}", f"{row['coverage90']:.0%}"]
        rows.append(cells)
    return told + table(names, rows)


def _with_paper(ours: float, theirs: float | None) -> str:
    return f"{ours:.2f}" if theirs is None else f"{ours:.2f} ({theirs:.2f})"


if __name__ == "__main__":
    write_results("multifactor", markdown, *sys.argv[1:])
