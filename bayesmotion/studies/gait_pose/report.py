"""The gait-pose study's results as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.gait_pose.report docs/gait-pose.md docs/results/gait-pose.json``
writes them into the page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ..tables import table, write_results
from .learning import faster

NAMES = {
    "torus3": "torus, three layers",
    "cylinder3": "cylinder, three layers",
    "torus1": "torus, one layer (JGPM)",
    "ll_gpdm": "LL-GPDM",
    "on_torus3": "on the torus, three layers",
    "pca": "3 principal components",
    "nearest": "nearest pose",
    "savgol": "Savitzky-Golay",
    "noisy": "as measured",
}


def markdown(result: Mapping[str, Any]) -> str:
    """Give all tables of what has been done."""
    parts = [
        f"{result['training_cycles']} training cycles of "
        f"{len(result['training_subjects'])} people. Mean error in millimetres over test "
        "cycles and its standard error."
    ]
    if "training" in result:
        parts.append(_training(result["training"]))
    if "interpolation" in result:
        parts.append(_table("Interpolation, all joints", result["interpolation"]))
    if "swings" in result:
        parts.append(_swings(result["swings"]))
    for case, by_scale in result.get("reconstruction", {}).items():
        parts.append(_table(f"Reconstruction, {case} missing, the joints that move", by_scale))
    for case, by_scale in result.get("reconstruction_shared", {}).items():
        title = f"The same, {case}, with residuals that features share"
        parts.append(_table(title, by_scale))
    if "coverage90" in result:
        parts.append(_coverage(result["coverage90"]))
    for noise, by_scale in result.get("filtering", {}).items():
        parts.append(_table(f"Filtering, noise of {100 * float(noise):g} %", by_scale))
    if "held_out" in result:
        parts.append(_topologies(result["held_out"]))
    if "learning" in result:
        parts.append(_learning(result["learning"]))
    if "step_milliseconds" in result:
        steps = result["step_milliseconds"]
        told = ", ".join(f"{ms:.2f} ms with {int(n):,} points" for n, ms in steps.items())
        parts.append(f"A local step takes {told}.")
    return "\n\n".join(parts)


def _training(fits: Mapping[str, Mapping[str, Any]]) -> str:
    rows = []
    for name, fit in fits.items():
        # Local learning has no end but that of its sweeps.
        told = {True: "yes", False: "no", None: "after all sweeps"}[fit["converged"]]
        title = NAMES.get(name, name.replace("_", " "))
        rows.append([title, f"{fit['seconds']:.0f}", f"{fit['log_density']:,.0f}", told])
    return table(["trained", "seconds", "log density", "converged"], rows)


def _table(title: str, by_scale: Mapping[str, Mapping[str, list[float]]]) -> str:
    scales = list(by_scale)
    names = list(dict.fromkeys(name for row in by_scale.values() for name in row))
    rows = []
    for name in names:
        cells = [f"{by_scale[s][name][0]:.1f} ± {by_scale[s][name][1]:.1f}" for s in scales]
        rows.append([NAMES.get(name, name), *cells])
    return f"{title}:\n\n" + table(["", *scales], rows)


def _swings(found: Mapping[str, Mapping[str, list[float]]]) -> str:
    limbs = {"larm": "left arm", "rarm": "right arm", "lleg": "left leg", "rleg": "right leg"}
    told = (
        "How far limbs swing in the recorded long strides, in what they do in the middle training "
        "cycle. The outer layer makes a quarter more of what is recorded:\n\n"
    )
    rows = []
    for limb, row in found.items():
        (mean, largest), (_, known) = row["strides"], row["training"]
        rows.append([limbs[limb], f"{mean:.2f}", f"{largest:.2f}", f"{known:.2f}"])
    head = ["limb", "strides, mean", "strides, largest", "training, largest"]
    return told + table(head, rows)


def _coverage(coverage: Mapping[str, Mapping[str, Mapping[str, float]]]) -> str:
    scales, rows = list(next(iter(coverage.values()))), []
    for case, by_scale in coverage.items():
        for name in by_scale[scales[0]]:
            cells = [f"{100 * by_scale[scale][name]:.0f} %" for scale in scales]
            rows.append([case, NAMES.get(name, name), *cells])
    return "Share of missing angles in their 90 % interval:\n\n" + table(["", "", *scales], rows)


def _topologies(found: Mapping[str, Any]) -> str:
    title = (
        "Log density of the left side given the rest, an entry, of one layer at scale 1, and the "
        "difference from no topology:\n\n"
    )
    rows = []
    for name, (mean, error) in found["per_entry"].items():
        against = found["against_none"].get(name)
        told = f"{against[0]:+.3f} ± {against[1]:.3f}" if against else ""
        rows.append([name, f"{mean:.3f} ± {error:.3f}", told])
    return title + table(["topology", "log density", "against none"], rows)


def _learning(found: Mapping[str, Any]) -> str:
    title = (
        "Local learning of 1,800 points, and how many times longer full learning took to the "
        "same log density within 1 %:\n\n"
    )
    rows = []
    for sweeps, seconds, reached in found["local"]:
        ratio = found["full_over_local"][str(int(sweeps))]
        told = f"{ratio:.1f}" if ratio is not None else "not reached"
        rows.append([str(int(sweeps)), f"{seconds:.1f}", f"{reached:,.0f}", told])
    steps, seconds, best = found["full"][-1]
    told = f"Full learning: {best:,.0f} after {int(steps)} steps, {seconds:.0f} s."
    ratio = faster(found["local"], found["full"])["full_over_local_to_last"]
    if ratio is None:
        told += " Local learning does not come to within 1 % of that."
    else:
        told += f" To within 1 % of that it takes {ratio:.1f} times as long as local learning."
    head = ["sweeps", "seconds", "log density", "full / local"]
    return f"{title}{table(head, rows)}\n\n{told}"


if __name__ == "__main__":
    write_results("gait-pose", markdown, *sys.argv[1:])
