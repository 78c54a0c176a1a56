"""The voxel study's results as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.voxel.report docs/voxel.md docs/results/voxel.json``
writes them into the page's block. Stages the file does not hold are left out.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ..tables import table, write_results

NAMES = {
    "rvm_mppca": "relevance vectors, mixture of PPCA",
    "rvm_kmeans": "relevance vectors, k-means",
    "ridge": "ridge regression, mixture of PPCA",
    "nearest": "nearest training frame, mixture of PPCA",
    "moments": "relevance vectors, moments of silhouettes",
    "agarwal_triggs": "Agarwal and Triggs, in the paper",
}
SETUPS = {
    "six": "the six that trained",
    "six_others": "six others, half way between",
    "four": "four others",
    "nearer_higher": "six nearer and higher",
    "noisy": "the six, noisy silhouettes",
}
PARTS = {
    "full_body": "full body",
    "heading": "heading",
    "left_shoulder": "left shoulder",
    "right_hip": "right hip",
}
STAGES = {
    "silhouettes": "silhouettes of six cameras",
    "voxels": "silhouettes to voxels",
    "descriptors": "voxels to descriptors",
    "features_and_regression": "descriptors to pose",
    "voxels_to_pose": "voxels to pose",
}
CURVES = {
    "radius": "radius of the support, in heights",
    "radial_bins": "radial bins",
    "components": "components of the mixture",
    "latent": "latent dimensions of a component",
    "share": "share of the poses' variance",
    "least_noise": "least noise, as a share of an output's variance",
}


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of the stages the study has come to."""
    parts = []
    if "motions" in result:
        parts += [_motions(result), _table1(result)]
    if result.get("cameras"):
        parts.append(_cameras(result["cameras"]))
    if "subjects_apart" in result:
        parts.append(_others(result))
    if "fps" in result:
        parts.append(_speed(result))
    if "curves" in result:
        parts.append(_curves(result["curves"]))
    return "\n\n".join(parts)


def _rows(columns: Mapping[str, Mapping[str, float]]) -> list[list[str]]:
    """Return a row a model, in every column its number; a dash where there is no number."""
    models = [name for name in NAMES if any(name in row for row in columns.values())]
    return [
        [NAMES[name], *(f"{row[name]:.2f}" if name in row else "-" for row in columns.values())]
        for name in models
    ]


def _motions(result: Mapping[str, Any]) -> str:
    motions, kept = result["motions"], result["relevance_vectors"]
    columns = {**motions, "mean": result["means"]}
    covered = result["coverage90"]
    absolute = result["motions_absolute"]
    smooth = result.get("smoothed")
    smoothed = []
    if smooth is not None:
        errors = [*smooth["motions"].values(), smooth["mean"]]
        smoothed = [["the first, smoothed over time", *(f"{x:.2f}" for x in errors)]]
    size = [f"{100 * covered[m]:.0f} %" for m in motions]
    mean = f"{100 * result['coverage90_mean']:.0f} %"
    off = [result["motions_turned"][m]["rvm_mppca"] for m in motions]
    ours = [absolute[m]["rvm_mppca"] for m in motions]
    rows = [
        *_rows(columns),
        *smoothed,
        ["joints of the first turned off by", *(f"{x:.2f}" for x in [*off, sum(off) / len(off)])],
        ["the first by the paper's eq. 6", *(f"{x:.2f}" for x in [*ours, sum(ours) / len(ours)])],
        ["90 % intervals of the first cover", *size, mean],
    ]
    paper = ", ".join(f"{name} {error}" for name, error in result["paper"]["motions"].items())
    frames = sum(result["frames"]["training"].values())
    return (
        "Errors in degrees, clips apart, with the cameras that trained:\n\n"
        + table(["", *columns], rows)
        + f"\n\nOf {kept[1]} training points {kept[0]} ({100 * kept[0] / kept[1]:.0f} %) are kept "
        f"as relevance vectors; {frames} frames and their mirror images trained in "
        f"{result['seconds']['training'] / 60:.1f} minutes. The paper has, on its own motions: "
        f"{paper}; {result['paper']['relevance_vectors'][0]} relevance vectors of "
        f"{result['paper']['relevance_vectors'][1]}."
    )


def _table1(result: Mapping[str, Any]) -> str:
    ours = {PARTS[name]: row for name, row in result["table1"].items()}
    paper = {PARTS[name]: row for name, row in result["paper"]["table1"].items()}
    return (
        "Turning walks in parts, degrees:\n\n"
        + table(["", *ours], _rows(ours))
        + "\n\nThe paper's spiral walk:\n\n"
        + table(["", *paper], _rows(paper))
    )


def _cameras(cameras: Mapping[str, Mapping[str, float]]) -> str:
    columns = {SETUPS[name]: row for name, row in cameras.items()}
    return "Means over the motions with other cameras, degrees:\n\n" + table(
        ["", *columns], _rows(columns)
    )


def _others(result: Mapping[str, Any]) -> str:
    columns = result["subjects_apart"]
    covered = [f"{100 * x:.0f} %" for x in result["subjects_apart_coverage90"].values()]
    rows = [*_rows(columns), ["90 % intervals of the first cover", *covered]]
    return "People none of whom trained, degrees:\n\n" + table(["", *columns], rows)


def _speed(result: Mapping[str, Any]) -> str:
    rows = [[STAGES[name], f"{rate:.0f}"] for name, rate in result["fps"].items()]
    return "Frames a second on one core:\n\n" + table(["", "frames a second"], rows)


def _curves(curves: Mapping[str, Mapping[str, float]]) -> str:
    parts = []
    for name, errors in curves.items():
        row = ["degrees", *(f"{error:.2f}" for error in errors.values())]
        parts.append(table([CURVES[name], *errors], [row]))
    return "Half of the training frames held out, stretch by stretch (Figure 4):\n\n" + "\n\n".join(
        parts
    )


if __name__ == "__main__":
    write_results("voxel", markdown, *sys.argv[1:])
