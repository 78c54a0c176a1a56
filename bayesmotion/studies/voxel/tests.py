"""What the voxel study tests, once everything is trained."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...models.clusters import Clusters
from ...models.voxel_pose import VoxelPose
from ...models.voxel_pose.features import Descriptors, describe
from ...models.voxel_pose.joint_angles import rms_degrees
from ...models.voxel_pose.mixture_ppca.density import Mixture
from ..stages import Say, kept_arrays
from .data import MOTIONS, OTHERS, Seen, observe_all, thinned, together
from .figures import draw_figures
from .models import (
    Contest,
    Inputs,
    Recognizer,
    Regressor,
    absolute,
    coverage,
    errors,
    inputs_in_parts,
    inputs_of,
    means,
    parts,
    turned,
)
from .smooth import likeliest_length, smooth

RATE = 120.0  # frames a second of the recordings


def kept_inputs(
    seen: Seen,
    model: VoxelPose,
    mixture: Mixture,
    clusters: Clusters,
    path: Path,
    say: Say,
    descriptors: Callable[[], Descriptors] | None = None,
) -> Inputs:
    """Return what the regressions see, from the file if it is there."""

    def make() -> dict[str, np.ndarray]:
        if descriptors is not None:
            found = inputs_of(seen, descriptors(), mixture, clusters)
        else:
            found = inputs_in_parts(seen, model, mixture, clusters)
        say(f"{path.parent.name}, {path.stem}: described")
        return vars(found)

    return Inputs(**kept_arrays(path, make))


@dataclass(frozen=True)
class Tests:
    """What is tested, with what was trained.

    out, cache
        Folders for pictures, and for what is seen and made of it; the latter is of one plan.
    """

    training: dict[str, Seen]
    fit: Recognizer
    clusters: Clusters
    contest: Contest
    data: Path | None
    out: Path
    cache: Path
    seed: int
    say: Say

    def cameras(self, setup: str) -> dict[str, Any]:
        """Test with a setup of cameras; with the six that trained, in every way."""
        # Of other cameras every third frame will do.
        clips = MOTIONS if setup == "six" else thinned(MOTIONS)
        seen = observe_all(clips, "test", setup, self.data, self.cache, self.seed, self.say)
        inputs = self._inputs(seen, self.cache / setup)
        found = {name: self.contest(one) for name, one in inputs.items()}
        table = {name: errors(one.angles, found[name]) for name, one in seen.items()}
        if setup != "six" and setup != "noisy":
            for row in table.values():
                row.pop("moments", None)  # of other cameras they mean nothing
        result: dict[str, Any] = {"cameras": means(table)}
        if setup == "six":
            result |= _tables(seen, found, inputs, self.contest, table)
            result["smoothed"] = _smoothed(self.training, seen, inputs, self.fit.regressor)
            result["fps"] = speed(seen, self.fit)
            draw_figures(seen, self.fit, self.data, self.out)
        return result

    def others(self) -> dict[str, Any]:
        """Test on people none of whom trained."""
        cache = self.cache / "others"
        seen = observe_all(OTHERS, "test", "six", self.data, cache, self.seed, self.say)
        inputs = self._inputs(seen, cache)
        regressor = self.contest.regressors["rvm_mppca"]
        rows, covered = {}, {}
        for name, one in seen.items():
            rows[name] = errors(one.angles, self.contest(inputs[name]))
            covered[name] = coverage(one.angles, *regressor(inputs[name].mppca))
        return {"subjects_apart": rows, "subjects_apart_coverage90": covered}

    def _inputs(self, seen: dict[str, Seen], folder: Path) -> dict[str, Inputs]:
        return {
            name: kept_inputs(
                one,
                self.fit.model,
                self.fit.mixture,
                self.clusters,
                folder / f"{name}_inputs.npz",
                self.say,
            )
            for name, one in seen.items()
        }


def _tables(seen, found, inputs, contest: Contest, table: dict) -> dict[str, Any]:
    """Return Tables 1 and 2, and how often intervals hold."""
    regressor = contest.regressors["rvm_mppca"]
    covered = {
        name: coverage(one.angles, *regressor(inputs[name].mppca)) for name, one in seen.items()
    }
    return {
        "motions": table,
        "means": means(table),
        "motions_absolute": {name: absolute(one.angles, found[name]) for name, one in seen.items()},
        "motions_turned": {name: turned(one.angles, found[name]) for name, one in seen.items()},
        "table1": parts(seen["turn"].angles, found["turn"], seen["turn"].labels),
        "coverage90": covered,
        "coverage90_mean": float(np.mean(list(covered.values()))),
    }


def _smoothed(
    training: dict[str, Seen],
    seen: dict[str, Seen],
    inputs: dict[str, Inputs],
    regressor: Regressor,
) -> dict[str, Any]:
    """Return the errors of the paper's model with its poses made smooth over time."""
    known = together(list(training.values()))
    z = regressor.space.encode(known.angles)
    length = likeliest_length(z, known.frame / RATE, _numbers(known.clip))
    rows = {}
    for name, one in seen.items():
        mean, variance = regressor.outputs(inputs[name].mppca)
        mean, _ = smooth(mean, variance, one.frame / RATE, _numbers(one.clip), length)
        rows[name] = rms_degrees(one.angles, regressor.space.decode(mean))
    return {"length_seconds": length, "motions": rows, "mean": float(np.mean([*rows.values()]))}


def _numbers(clip: np.ndarray) -> np.ndarray:
    return np.unique(clip, return_inverse=True)[1]


def speed(seen: dict[str, Seen], fit: Recognizer, frames: int = 60) -> dict[str, float]:
    """Measure frames a second of every stage, on some test frames, after a first one."""
    one = seen["turn"]
    shells = [hull for hull, _ in zip(one.hulls(), range(frames), strict=False)]
    fit(describe(shells[:1], fit.model.context, fit.model.cell))
    began = time.perf_counter()
    described = [describe([hull], fit.model.context, fit.model.cell) for hull in shells]
    described_at = time.perf_counter()
    for single in described:
        fit(single)
    end = time.perf_counter()
    drawn, carved = one.seconds
    return {
        "silhouettes": float(1.0 / drawn),
        "voxels": float(1.0 / carved),
        "descriptors": len(shells) / (described_at - began),
        "features_and_regression": len(shells) / (end - described_at),
        "voxels_to_pose": len(shells) / (end - began),
    }
