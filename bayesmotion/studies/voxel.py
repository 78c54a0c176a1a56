"""Reproduce Sun et al. (2006): Tables 1 and 2, the curves of Figure 4, Figures 2 and 5.

Silhouettes are drawn from real motion capture, as in the paper. The regression is trained
with six cameras and tested with the same six on other clips, with other cameras, noisy
silhouettes and other people. Everything that is chosen (bins, Q, the kernel's length) is
the paper's, or chosen on training clips; the curves hold half of the training frames out.

Errors are in degrees: the root mean square over frames, averaged over the 42 angles of the
paper's 14 joints, as BVH files have them.

What is worked out is kept under ``cache`` and ``fits``, stage by stage: a run that is
interrupted goes on where it was.
"""

import json
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..files import replacing, write_json
from ..models.clusters import Clusters, find_clusters
from ..models.joint_angles import rms_degrees
from ..models.mixture_em import Mixture, fit_mixture
from ..motion import Skeleton, skeletons
from ..motion.datasets import cmu
from ..tasks.voxel_features import Descriptors, describe
from ..tasks.voxel_files import load_regressor, save_regressor, save_voxel_pose
from ..tasks.voxel_pose import Regressor, Settings, VoxelPose, train_regressor
from ..tasks.voxel_smooth import likeliest_length, smooth
from .voxel_curves import curves
from .voxel_data import (
    MOTIONS,
    OTHERS,
    SETUPS,
    Say,
    Seen,
    observe_all,
    reflected,
    thinned,
    together,
)
from .voxel_figures import draw_figures
from .voxel_models import (
    Contest,
    Inputs,
    Nearest,
    Ridge,
    Scaled,
    absolute,
    coverage,
    errors,
    inputs_in_parts,
    inputs_of,
    means,
    parts,
    turned,
)

# Some 43 descriptors of every training frame, about a sixth of them all.
SETTINGS = Settings(points=80_000, mixture_steps=9)
STEPS_KEPT = 3  # steps of EM after which the mixture is kept
RATE = 120.0  # frames a second of the recordings
# Sun et al. (2006), Tables 1 and 2, degrees.
PAPER = {
    "table1": {
        "full_body": {"rvm_mppca": 5.2, "agarwal_triggs": 6.0, "rvm_kmeans": 5.4},
        "heading": {"rvm_mppca": 8.8, "agarwal_triggs": 17.0, "rvm_kmeans": 12.0},
        "left_shoulder": {"rvm_mppca": 6.3, "agarwal_triggs": 7.5, "rvm_kmeans": 6.5},
        "right_hip": {"rvm_mppca": 3.2, "agarwal_triggs": 4.2, "rvm_kmeans": 3.8},
    },
    "motions": {
        "regular walk": 2.5,
        "drunken walk": 5.0,
        "spiral walk": 5.3,
        "jog": 5.6,
        "jump": 4.9,
    },
    "relevance_vectors": [418, 1744],
}


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict:
    """Train, test, and write ``voxel.json``, fits and pictures to `out`.

    Parameters
    ----------
    data
        Folder that holds ``cmu/``; where None as in `bayesmotion.motion.datasets.cmu`.
    out
        Folder for the results, and for what goes on from an interrupted run.
    say
        Called with a line after every stage.
    seed
        The one seed.
    """
    cache = out / "cache"
    training = observe_all(MOTIONS, "train", "six", data, cache, seed, say)
    fit, clusters, contest = _trained(training, data, out, seed, say)
    kept = fit.regressor.relevant.kept
    result: dict[str, Any] = {
        "seed": seed,
        "settings": asdict(SETTINGS),
        "paper": PAPER,
        "relevance_vectors": [len(kept), fit.regressor.of],
        "pose_dimensions": len(fit.regressor.space.scale),
        "angles": len(fit.regressor.space.labels),
        "converged": bool(fit.regressor.relevant.converged),
        "seconds": {"training": fit.seconds},
        "frames": {"training": {name: len(one.counts) for name, one in training.items()}},
        "cameras": {},
    }
    for setup in SETUPS:
        # Of other cameras every third frame will do.
        clips = MOTIONS if setup == "six" else thinned(MOTIONS)
        seen = observe_all(clips, "test", setup, data, cache, seed, say)
        inputs = {
            name: _inputs(one, fit.mixture, clusters, cache / setup / f"{name}_inputs.npz", say)
            for name, one in seen.items()
        }
        found = {name: contest(one) for name, one in inputs.items()}
        table = {name: errors(one.angles, found[name]) for name, one in seen.items()}
        if setup != "six" and setup != "noisy":
            for row in table.values():
                row.pop("moments", None)  # of other cameras they mean nothing
        result["cameras"][setup] = means(table)
        say(f"{setup}: " + ", ".join(f"{n} {e:.2f}" for n, e in means(table).items()))
        if setup == "six":
            result |= _tables(seen, found, inputs, contest, table)
            result["smoothed"] = _smoothed(training, seen, inputs, fit.regressor)
            result["fps"] = speed(seen, fit)
            draw_figures(seen, fit, data, out)
        write_json(out / "voxel.json", result)
    result |= _others(data, cache, fit, clusters, contest, seed, say)
    write_json(out / "voxel.json", result)
    result["curves"] = curves(training, SETTINGS, out / "curves.json", seed, say)
    write_json(out / "voxel.json", result)
    return result


def _trained(
    training: dict[str, Seen], data: Path | None, out: Path, seed: int, say: Say
) -> tuple[VoxelPose, Clusters, Contest]:
    """Train everything, or read it back."""
    plain, fits, cache = together(list(training.values())), out / "fits", out / "cache" / "six"
    described: list[Descriptors] = []

    def descriptors() -> Descriptors:
        # Only if something is still to be trained: they take long, and much memory.
        if not described:
            described.append(_descriptors(plain, cache / "descriptors.npz", say))
        return described[0]

    mixture, seconds = _mixture(descriptors, fits / "mixture.npz", seed, say)
    shares = mixture, _clusters(descriptors, fits / "clusters.npz", seed)
    own = _inputs(plain, *shares, cache / "training_inputs.npz", say, descriptors)
    # Everything is trained on the frames as they are and in a mirror.
    mirror = reflected(plain)
    other = _inputs(mirror, *shares, cache / "mirrored_inputs.npz", say)
    seen = together([plain, mirror])
    inputs = Inputs(*map(np.concatenate, zip(own.parts, other.parts, strict=True)))
    scaled = Scaled.of(inputs.moments)
    given = {
        "rvm_mppca": inputs.mppca,
        "rvm_kmeans": inputs.kmeans,
        "moments": scaled(inputs.moments),
    }
    regressors, times = {}, {}
    for name, x in given.items():
        regressors[name], times[name] = _regressor(x, seen, fits / f"{name}.nc", say)
    skeleton, rest = mean_pose(data)
    fit = VoxelPose(
        SETTINGS, mixture, regressors["rvm_mppca"], skeleton, rest, seed,
        seconds + times["rvm_mppca"],
    )  # fmt: skip
    save_voxel_pose(fit, fits / "voxel.nc")
    ridge = Ridge.of(inputs.mppca, seen.angles, seen.labels)
    contest = Contest(regressors, ridge, Nearest(inputs.mppca, seen.angles), scaled)
    return fit, shares[1], contest


def _descriptors(seen: Seen, path: Path, say: Say) -> Descriptors:
    if not path.is_file():
        found = describe(seen.hulls(), SETTINGS.context, SETTINGS.cell)
        with replacing(path) as temporary:
            np.savez(temporary, values=found.values, counts=found.counts)
        say(f"{len(found.values)} descriptors of {len(found.counts)} training frames")
    with np.load(path) as stored:
        return Descriptors(stored["values"], stored["counts"])


def _mixture(
    descriptors: Callable[[], Descriptors], path: Path, seed: int, say: Say
) -> tuple[Mixture, float]:
    """Train the mixture, some steps at a time; give it and the seconds it took."""
    names = ("weight", "mean", "factor", "noise")
    while True:
        done, seconds, start = 0, 0.0, None
        if path.is_file():
            with np.load(path) as stored:
                done, seconds = int(stored["done"]), float(stored["seconds"])
                start = Mixture(*(stored[name] for name in names))
        if start is not None and done >= SETTINGS.mixture_steps:
            return start, seconds
        points = descriptors().sample(SETTINGS.points, seed)
        began = time.perf_counter()
        steps = min(STEPS_KEPT, SETTINGS.mixture_steps - done)
        found = fit_mixture(
            points, SETTINGS.components, SETTINGS.latent, seed=seed, max_steps=steps, start=start
        )
        done = SETTINGS.mixture_steps if found.converged else done + steps
        seconds += time.perf_counter() - began
        kept = {name: getattr(found.mixture, name) for name in names}
        with replacing(path) as temporary:
            np.savez(temporary, done=done, seconds=seconds, **kept)
        height = found.log_likelihood[-1] / len(points)
        say(f"mixture: {done} steps, log likelihood {height:.2f} a point, {seconds:.0f} s")


def mean_pose(data: Path | None) -> tuple[Skeleton, dict[str, float]]:
    """Give the first subject's skeleton, and the mean angle of each degree of freedom.

    Angles in radians, over the clips that train.
    """
    trials = [clip for chosen in MOTIONS.values() for clip in chosen.train]
    motion = cmu(trials, None if data is None else data / "cmu")
    skeleton = next(iter(skeletons(motion).values()))
    return skeleton, {dof: float(motion["angle"].sel(dof=dof).mean()) for dof in skeleton.dofs}


def _clusters(descriptors: Callable[[], Descriptors], path: Path, seed: int) -> Clusters:
    if not path.is_file():
        points = descriptors().sample(SETTINGS.points, seed)
        found = find_clusters(points, SETTINGS.components, seed=seed)
        with replacing(path) as temporary:
            np.savez(temporary, centre=found.centre, spread=found.spread)
    with np.load(path) as stored:
        return Clusters(stored["centre"], float(stored["spread"]))


def _inputs(
    seen: Seen,
    mixture: Mixture,
    clusters: Clusters,
    path: Path,
    say: Say,
    descriptors: Callable[[], Descriptors] | None = None,
) -> Inputs:
    """Give what the regressions see, from the file if it is there."""
    if not path.is_file():
        if descriptors is not None:
            found = inputs_of(seen, descriptors(), mixture, clusters)
        else:
            found = inputs_in_parts(seen, SETTINGS, mixture, clusters)
        with replacing(path) as temporary:
            np.savez(temporary, **vars(found))
        say(f"{path.parent.name}, {path.stem}: described")
    with np.load(path) as stored:
        return Inputs(**{name: stored[name] for name in stored.files})


def _regressor(x: np.ndarray, seen: Seen, path: Path, say: Say) -> tuple[Regressor, float]:
    """Give a regression, from the file if it is there, and the seconds its training took."""
    took = path.with_suffix(".json")
    if not path.is_file() or not took.is_file():
        say(f"training {path.stem}")
        began = time.perf_counter()
        save_regressor(train_regressor(x, seen.angles, seen.labels, SETTINGS, say), path)
        write_json(took, {"seconds": time.perf_counter() - began})
    return load_regressor(path), float(json.loads(took.read_text(encoding="utf-8"))["seconds"])


def _tables(seen, found, inputs, contest: Contest, table: dict) -> dict[str, Any]:
    """Give Tables 1 and 2, and how often intervals hold."""
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
    """Give the errors of the paper's model with its poses made smooth over time."""
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


def _others(data, cache, fit, clusters, contest, seed: int, say: Say) -> dict[str, Any]:
    """Test on people none of whom trained."""
    seen = observe_all(OTHERS, "test", "six", data, cache / "others", seed, say)
    rows, covered = {}, {}
    for name, one in seen.items():
        inputs = _inputs(one, fit.mixture, clusters, cache / "others" / f"{name}_inputs.npz", say)
        rows[name] = errors(one.angles, contest(inputs))
        covered[name] = coverage(one.angles, *contest.regressors["rvm_mppca"](inputs.mppca))
    return {"subjects_apart": rows, "subjects_apart_coverage90": covered}


def speed(seen: dict[str, Seen], fit: VoxelPose, frames: int = 60) -> dict[str, float]:
    """Measure frames a second of every stage, on some test frames, after a first one."""
    one = seen["turn"]
    shells = [hull for hull, _ in zip(one.hulls(), range(frames), strict=False)]
    fit.recognise(describe(shells[:1], fit.settings.context, fit.settings.cell))
    began = time.perf_counter()
    described = [describe([hull], fit.settings.context, fit.settings.cell) for hull in shells]
    middle = time.perf_counter()
    for single in described:
        fit.recognise(single)
    end = time.perf_counter()
    drawn, carved = one.seconds
    return {
        "silhouettes": float(1.0 / drawn),
        "voxels": float(1.0 / carved),
        "descriptors": len(shells) / (middle - began),
        "features_and_regression": len(shells) / (end - middle),
        "voxels_to_pose": len(shells) / (end - began),
    }
