"""One page of all results, models by tasks: every cell is drawn from a file of results.

``python -m bayesmotion.studies.leaderboard docs/leaderboard.md docs/results`` writes the blocks of
the page, one a task. Uncertainty stands beside every figure: a standard error, or an interval.
"""

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .boards.harness import summary
from .gait_pose.report import NAMES as POSES
from .gpode.study import PUBLISHED as GPODE_PUBLISHED
from .tables import page_block, table, write_block

Result = Mapping[str, Any]
SCALE = "1"
PROCESSES = {
    "gpdm": "GPDM",
    "gpdm_style": "GPDM with style",
    "bgpdm": "B-GPDM",
    "bgpdm_style": "B-GPDM with style",
    "cdm_style": "circle with style, as in the paper but for second-order noise",
}
RECOGNISERS = {
    "tensor_paper": "tensor, nearest vectors (the paper)",
    "tensor_bayes": "Bayesian Tucker",
    "nearest": "1-NN",
    "discriminant": "linear discriminant",
}
FACES = {
    "sgplvm_a": "shared GPLVM, A",
    "sgplvm_b": "shared GPLVM, B",
    "sgplvm_window": "shared GPLVM on windows of sound",
    "voice_puppetry": "voice puppetry",
    "ridge": "ridge regression",
}
SMOOTHERS = {
    "measured": "as measured",
    "laboratory": "6 Hz Butterworth",
    "best_cutoff": "Butterworth, cutoff chosen on training trials",
    "known": "`bm.denoise`, noise known",
    "estimated": "`bm.denoise`",
}


def forecasts(result: Result) -> str:
    """Return forecasts of the six-clip study, simple ones among them."""
    rows = []
    for name, clips in result["test"].items():
        over = summary(clips)
        title = name if name in result["settings"]["simple"] else f"circle with style, {name}"
        cells = [_pm(over[each], places) for each, places in (("error", 3), ("crps", 4))]
        cells.append(f"{over['log_score']['mean']:.2f}")
        rows.append([title, *cells, f"{100 * over['coverage90']['mean']:.0f} %"])
    return table(["", "error, rad", "CRPS, rad", "log score", "90 % hold"], rows)


def processes(result: Result) -> str:
    """Return the dynamics of the six-clip study at their modes."""
    rows = []
    for name, title in PROCESSES.items():
        errors = np.array([clip[name] for clip in result["table1"].values()])
        held = np.mean([clip[name] for clip in result["coverage90"].values()])
        title += "" if result["converged"][name] else " (not converged)"
        rows.append([title, _mean_and_error(errors, 2), f"{100 * held:.0f} %"])
    return table(["", "error, rad", "90 % hold"], rows)


def cmu35(result: Result) -> str:
    """Return the board of subject 35, told by all 19 clips."""
    rows = [_on_board(name, found) for name, found in result["test"]["19 clips"].items()]
    return table(["", "MSE, square degrees", "95 % over clips", "90 % hold"], rows)


def gpode(result: Result) -> str:
    """Return the boards of three subjects, others' figures beside."""
    subjects = list(result["test"])
    names = list(dict.fromkeys(name for found in result["test"].values() for name in found))
    rows = [
        [name, *(_mse(result["test"][subject].get(name)) for subject in subjects)] for name in names
    ]
    rows += [
        [f"{name} ({source})", *map(str, figures)]
        for name, (figures, source) in GPODE_PUBLISHED.items()
    ]
    return table(["MSE, square degrees", *(f"subject {one}" for one in subjects)], rows)


def limbs(result: Result) -> str:
    """Return what gait-pose models say of missing limbs at the training people's scale."""
    cases = list(result["reconstruction"])
    names = list(result["reconstruction"][cases[0]][SCALE])
    rows = [
        [POSES.get(name, name),
         *("{:.1f} ± {:.1f}".format(*result["reconstruction"][c][SCALE][name]) for c in cases)]
        for name in names
    ]  # fmt: skip
    return table(["error, mm", *cases], rows)


def denoising(result: Result) -> str:
    """Return the error that is left of noise, over trials."""
    levels = list(next(iter(result["trials"].values())))
    rows = []
    for name, title in SMOOTHERS.items():
        errors = {
            level: np.array([trial[level]["error_mm"][name] for trial in result["trials"].values()])
            for level in levels
        }
        rows.append([title, *(_mean_and_error(each, 2) for each in errors.values())])
    return table(["error, mm", *(f"{level} degrees of noise" for level in levels)], rows)


def gaps(result: Result) -> str:
    """Return the error in gaps of markers, in the mean over recordings, by length of gap."""
    found = result["gaps"]
    lengths = list(next(iter(found.values())))
    first = found[next(iter(found))][lengths[0]]
    names = list(next(iter(first.values()))["rms_mm"])
    rows = []
    for name in names:
        cells = [
            np.array([np.mean([cell["rms_mm"][name] for cell in one[length].values()])
                      for one in found.values()])
            for length in lengths
        ]  # fmt: skip
        title = "`bm.fill_gaps`" if name == "fill_gaps" else name.replace("_", " ")
        rows.append([title, *(_mean_and_error(cell, 1) for cell in cells)])
    return table(["RMS error, mm", *(f"{length} s" for length in lengths)], rows)


def recognition(result: Result) -> str:
    """Return how often people and tasks that are known are recognised."""
    known = result["known"]
    rows = []
    for name, title in RECOGNISERS.items():
        cells = []
        for what in ("task", "person"):
            low, high = known[f"{what}_interval"][name]
            cells.append(f"{known[what][name]:.3f} ({low:.3f} to {high:.3f})")
        rows.append([title, *cells])
    return table(["share recognised (95 % interval)", "task", "person"], rows)


def faces(result: Result) -> str:
    """Return the error of faces from sound."""
    rows = []
    for name, title in FACES.items():
        scores = result["ema"][name]
        rows.append([title, *(f"{m:.2f} ± {s:.2f}" for m, s in
                              (scores["rms_mm"], scores["lips_rms_mm"]))])  # fmt: skip
    return table(["RMS error, mm", "all markers", "lips"], rows)


# The block on the page, the file it is drawn from, and how.
TASKS: dict[str, tuple[str, Callable[[Result], str]]] = {
    "forecasts": ("pace", forecasts),
    "processes": ("multifactor", processes),
    "cmu35": ("cmu35", cmu35),
    "gpode": ("gpode", gpode),
    "limbs": ("gait-pose", limbs),
    "denoising": ("denoising", denoising),
    "gaps": ("gaps", gaps),
    "recognition": ("keypose", recognition),
    "faces": ("speech", faces),
}


def block(task: str, results: Path) -> str:
    """Return what stands on the page for a task, with the commit its file was made at."""
    name, told = TASKS[task]
    return page_block(told, json.loads((results / f"{name}.json").read_text(encoding="utf-8")))


def main(page: str, results: str) -> None:
    """Write all blocks of the page."""
    for task in TASKS:
        write_block(page, f"leaderboard-{task}", block(task, Path(results)))


def _pm(one: Mapping[str, float], places: int) -> str:
    return f"{one['mean']:.{places}f} ± {one['se']:.{places}f}"


def _mean_and_error(values: np.ndarray, places: int) -> str:
    error = values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():.{places}f} ± {error:.{places}f}"


def _mse(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return ""
    return f"{found['over_clips']['mse']['mean']:.2f}" + (
        "" if found.get("converged", True) else " (not converged)"
    )


def _on_board(name: str, found: Mapping[str, Any]) -> list[str]:
    over = found["over_clips"]
    low, high = over["mse"]["interval"]
    title = name + ("" if found.get("converged", True) else " (not converged)")
    held = f"{100 * over['coverage90']['mean']:.0f} %"
    return [title, f"{over['mse']['mean']:.2f}", f"{low:.1f} to {high:.1f}", held]


if __name__ == "__main__":
    main(*sys.argv[1:])
