"""Reproduce Sun et al. (2006): Tables 1 and 2, the curves of Figure 4, Figures 2 and 5.

Silhouettes are drawn from real motion capture, as in the paper. The regression is trained
with six cameras and tested with the same six on other clips, with other cameras, noisy
silhouettes and other people. Everything that is chosen (bins, Q, the kernel's length) is
the paper's, or chosen on training clips; the curves hold half of the training frames out.

Errors are in degrees: the root mean square over frames, averaged over the 42 angles of the
paper's 14 joints, as BVH files have them.

What is worked out is kept beside ``voxel.json``, stage by stage, in a folder of the settings'
own: a run that is interrupted goes on where it was.
"""

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...files import replacing, write_json
from ...models.clusters import Clusters, find_clusters
from ...models.voxel_pose import VoxelPose
from ...models.voxel_pose.features import Descriptors, describe
from ...models.voxel_pose.mixture_ppca.density import Mixture
from ...models.voxel_pose.mixture_ppca.em import fit_mixture
from ...motion import Skeleton, skeletons
from ...motion.datasets.public import cmu
from ...registry import describe_model
from ..stages import Say, Stages, kept_arrays
from .curves import curves, curves_plan
from .data import MOTIONS, OTHERS, SETUPS, TESTED, Seen, observe_all, reflected, together
from .models import (
    PENALTIES,
    Contest,
    Inputs,
    Nearest,
    Recognizer,
    Regressor,
    Ridge,
    Scaled,
)
from .tests import Tests, kept_inputs

# Some 43 descriptors of every training frame, about a sixth of them all.
SETTINGS = VoxelPose(mixture_points=80_000)
MIXTURE_STEPS = 9  # of EM
STEPS_KEPT = 3  # steps of EM after which the mixture is kept
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
        Folder that holds ``cmu/``; where None as in `bayesmotion.motion.datasets.public.cmu`.
    out
        Folder for the results, and for what goes on from an interrupted run.
    say
        Called with a line after every stage.
    seed
        The one seed.
    """
    stages = Stages(out / "voxel.json", plan(seed), say)
    kept, result = stages.folder, stages.result
    cache = kept / "cache"
    training = observe_all(MOTIONS, "train", "six", data, cache, seed, say)
    fewer = observe_all(MOTIONS, "train", "fewer", data, cache, seed, say)
    stages.read(**{f"training {name}": seen.angles for name, seen in training.items()})
    fit, clusters, contest = _trained(training, fewer, data, kept, seed, say)
    result |= {
        "paper": PAPER,
        "relevance_vectors": [len(fit.regressor.relevant.kept), fit.regressor.frames],
        "pose_dimensions": len(fit.regressor.space.scale),
        "angles": len(fit.regressor.space.labels),
        "converged": bool(fit.regressor.relevant.converged),
        "frames": {"training": {name: len(one.counts) for name, one in training.items()}},
        "cameras": {},
    }
    result["seconds"]["training"] = fit.seconds
    tests = Tests(training, fit, clusters, contest, data, out, cache, seed, say)
    # What tests find is kept as they give it, and put into the results' own order here.
    parts = Stages(kept / "tests.json", plan(seed), say)
    for setup in TESTED:
        found = parts.do("cameras", setup, work=lambda setup=setup: tests.cameras(setup))
        result["cameras"][setup] = found["cameras"]
        say(f"{setup}: " + ", ".join(f"{n} {e:.2f}" for n, e in found["cameras"].items()))
        result |= {name: value for name, value in found.items() if name != "cameras"}
        write_json(stages.path, result)
    result |= parts.do("others", work=tests.others)
    write_json(stages.path, result)
    result["curves"] = curves(training, SETTINGS, parts, seed)
    result["made_with"] |= {key: parts.result["made_with"][key] for key in ("commits", "versions")}
    write_json(stages.path, result)
    return result


def plan(seed: int) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "model": describe_model(SETTINGS),
        "mixture_steps": MIXTURE_STEPS,
        "penalties": PENALTIES.tolist(),
        "clips": {name: asdict(clips) for name, clips in MOTIONS.items()},
        "others": {name: asdict(clips) for name, clips in OTHERS.items()},
        "setups": {name: asdict(setup) for name, setup in SETUPS.items()},
        "curves": curves_plan(),
        "seed": seed,
    }


def _trained(
    training: dict[str, Seen],
    fewer: dict[str, Seen],
    data: Path | None,
    kept: Path,
    seed: int,
    say: Say,
) -> tuple[Recognizer, Clusters, Contest]:
    """Train everything, or read it back."""
    plain, fits, cache = together(list(training.values())), kept / "fits", kept / "cache" / "six"
    described: list[Descriptors] = []

    def descriptors() -> Descriptors:
        # Only if something is still to be trained: they take long, and much memory.
        if not described:
            described.append(_descriptors(plain, cache / "descriptors.npz", say))
        return described[0]

    mixture, seconds = _mixture(descriptors, fits / "mixture.npz", seed, say)
    shares = mixture, _clusters(descriptors, fits / "clusters.npz", seed)
    own = kept_inputs(plain, SETTINGS, *shares, cache / "training_inputs.npz", say, descriptors)
    # Everything is trained on the frames as all cameras see them and, in a mirror, as
    # fewer do.
    mirror = reflected(together(list(fewer.values())))
    other = kept_inputs(
        mirror, SETTINGS, *shares, kept / "cache" / "fewer" / "mirrored_inputs.npz", say
    )
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
        regressors[name], times[name] = _regressor(x, seen, fits / f"{name}.npz", say)
    skeleton, rest = mean_pose(data)
    seconds += times["rvm_mppca"]
    fit = Recognizer(SETTINGS, mixture, regressors["rvm_mppca"], skeleton, rest, seconds)
    ridge = Ridge.of(inputs.mppca, seen.angles, seen.labels)
    contest = Contest(regressors, ridge, Nearest(inputs.mppca, seen.angles), scaled)
    return fit, shares[1], contest


def _descriptors(seen: Seen, path: Path, say: Say) -> Descriptors:
    def make() -> dict[str, np.ndarray]:
        found = describe(seen.hulls(), SETTINGS.context, SETTINGS.cell)
        say(f"{len(found.values)} descriptors of {len(found.counts)} training frames")
        return {"values": found.values, "counts": found.counts}

    return Descriptors(**kept_arrays(path, make))


def _mixture(
    descriptors: Callable[[], Descriptors], path: Path, seed: int, say: Say
) -> tuple[Mixture, float]:
    """Train the mixture, some steps at a time; give it and the seconds it took."""
    while True:
        done, seconds, start = 0, 0.0, None
        if path.is_file():
            with np.load(path) as stored:
                done, seconds = int(stored["done"]), float(stored["seconds"])
                start = Mixture(*(stored[name] for name in Mixture._fields))
        if start is not None and done >= MIXTURE_STEPS:
            return start, seconds
        points = descriptors().sample(SETTINGS.mixture_points, seed)
        began = time.perf_counter()
        steps = min(STEPS_KEPT, MIXTURE_STEPS - done)
        found = fit_mixture(
            points, SETTINGS.components, SETTINGS.latent, seed=seed, max_steps=steps, start=start
        )
        done = MIXTURE_STEPS if found.converged else done + steps
        seconds += time.perf_counter() - began
        with replacing(path) as temporary:
            np.savez(temporary, done=done, seconds=seconds, **found.mixture._asdict())
        height = found.log_likelihood[-1] / len(points)
        say(f"mixture: {done} steps, log likelihood {height:.2f} a point, {seconds:.0f} s")


def mean_pose(data: Path | None) -> tuple[Skeleton, dict[str, float]]:
    """Return the first subject's skeleton, and the mean angle of each degree of freedom.

    Angles in radians, over the clips that train.
    """
    trials = [clip for chosen in MOTIONS.values() for clip in chosen.train]
    motion = cmu(trials, None if data is None else data / "cmu")
    skeleton = next(iter(skeletons(motion).values()))
    return skeleton, {dof: float(motion["angle"].sel(dof=dof).mean()) for dof in skeleton.dofs}


def _clusters(descriptors: Callable[[], Descriptors], path: Path, seed: int) -> Clusters:
    def make() -> dict[str, np.ndarray | float]:
        points = descriptors().sample(SETTINGS.mixture_points, seed)
        found = find_clusters(points, SETTINGS.components, seed=seed)
        return {"centre": found.centre, "sd": found.sd}

    stored = kept_arrays(path, make)
    return Clusters(stored["centre"], float(stored["sd"]))


def _regressor(x: np.ndarray, seen: Seen, path: Path, say: Say) -> tuple[Regressor, float]:
    """Return a regression, from the file if it is there, and the seconds its training took."""

    def make() -> dict[str, np.ndarray]:
        say(f"training {path.stem}")
        began = time.perf_counter()
        found = Regressor.of(x, seen.angles, seen.labels, SETTINGS, say).arrays()
        return {**found, "seconds": np.asarray(time.perf_counter() - began)}

    stored = kept_arrays(path, make)
    return Regressor.from_arrays(stored), float(stored["seconds"])
