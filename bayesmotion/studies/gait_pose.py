"""Reproduce Ding and Fan (2015) on real walks: interpolation, reconstruction, filtering.

Twenty training cycles of nine people and twenty test cycles of four others, all straight
walks of the CMU data base on one body (`motion.cycles`), with errors in millimetres over the
17 joints. Every setting was chosen on training cycles, by leaving people out.

Four models of the paper are trained: torus3 and cylinder3 on three stride scales by
local learning, torus1 and ll_gpdm on the recorded scale by full learning, as they were
published. Beside them stand principal components of the same dimension and the nearest
pose, of the same three scales as torus3, and for filtering a Savitzky-Golay filter whose window
is the best for the training cycles at that noise.

Each stage writes its part of ``gait-pose.json``; stages that are in it are not done again, so
that an interrupted run goes on where it was.
"""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..files import write_json
from ..fit import Fit, load
from ..inference.local import fit_local
from ..inference.map import fit_map
from ..models.gait_cycles import CycleEncoding
from ..models.gait_pose import LAYERS, SCALES, VARIANTS, GaitPose
from ..motion import concat, read_bvh, split
from ..motion.cycles import cycles_of, diversified
from ..motion.datasets import cmu
from ..motion.fetching import folders
from ..tasks.gait import (
    Trained,
    denoise,
    held_out_density,
    interpolate,
    limb_columns,
    moved_joints,
    trained_of,
    with_deviation,
    without,
)
from ..tasks.latent import pose_given, white_deviation
from ..tasks.pose_baselines import best_window, fit_pca, nearest_pose, smoothed

# Trial: cycles taken, the straightest ones. Of four people the BVH releases are at hand.
TRAINING = {
    "02_01": 2, "02_02": 2, "03_02": 1, "05_01": 3, "12_02": 2, "49_01": 3,
    "06_01.bvh": 2, "10_04.bvh": 2, "32_01.bvh": 1, "32_02.bvh": 1, "131_01.bvh": 1,
}  # fmt: skip
TEST = {
    "07_01": 1, "07_02": 1, "07_06": 1, "07_07": 1, "07_10": 1, "08_01": 1, "08_03": 1,
    "08_10": 1, "16_14": 1, "16_15": 2, "16_16": 2, "16_21": 1, "16_22": 1, "35_01": 1,
    "35_02": 1, "35_04": 1, "35_06": 1, "35_11": 1,
}  # fmt: skip
STRIDES = {"07_11": 1, "08_05": 1}
TEST_SCALES = (0.4, 0.5, 0.667, 1.0, 1.25)
CASES = {"left arm": ("larm",), "left leg": ("lleg",), "left side": ("larm", "lleg")}
NOISES = (0.05, 0.10, 0.15)
REPEATS = 2
MODELS = ("torus3", "cylinder3", "torus1", "ll_gpdm")
COMPONENTS = 3
SWEEPS, FULL_STEPS = 20, 150
# One sigma for all surfaces: that under which people left out of torus1 are nearest.
SIGMA = 0.03
TOPOLOGIES = {
    "torus": GaitPose("torus", sigma=SIGMA),
    "cylinder": GaitPose("cylinder", sigma=SIGMA),
    "none": GaitPose("none"),
}

Say = Callable[[str], None]


@dataclass(frozen=True)
class Walks:
    """The cycles of the study.

    training
        Recorded training cycles.
    test
        For every scale, and the strides, scaled features (C, T, D).
    encoding
        How they are scaled.
    """

    training: xr.Dataset
    test: dict[str, Float[np.ndarray, "c t d"]]
    encoding: CycleEncoding


def cut(trials: Mapping[str, int], data: Path | None) -> xr.Dataset:
    """Read trials and cut their cycles; of a BVH release the first frame is a rest pose."""
    root = None if data is None else data / "cmu"
    made = []
    for trial, most in trials.items():
        name, _, kind = trial.partition(".")
        if kind:
            subject = name.partition("_")[0]
            places = [folder / subject / trial for folder in folders("cmu", root)]
            path = next((place for place in places if place.is_file()), places[0])
            motion = read_bvh(path, labels={"subject": subject}, skip_first_frame=True)
            # The file tells the time of a frame in seven digits.
            motion = motion.assign_attrs(frame_rate=120.0)
        else:
            motion = cmu(name, root)
        made.append(cycles_of(motion, most))
    return concat(made)


def read_walks(data: Path | None) -> Walks:
    """Read everything the study is about."""
    training, test, strides = (cut(trials, data) for trials in (TRAINING, TEST, STRIDES))
    encoding = VARIANTS["gplvm"].prepare(training).encoding

    def features(motion: xr.Dataset) -> np.ndarray:
        return encoding.scaled(motion).reshape(len(split(motion)), -1, len(encoding.mean))

    scaled = {f"{scale:g}": features(diversified(test, scale)) for scale in TEST_SCALES}
    return Walks(training, {**scaled, "stride": features(strides)}, encoding)


def train(name: str, training: xr.Dataset, seed: int) -> Fit:
    """Fit one of the study's models and learn how new people differ from it."""
    model = VARIANTS[name]
    if model.surface != "none":
        model = replace(model, sigma=SIGMA)
    preparation = {"scales": list(LAYERS[name])}
    if name.endswith("3"):
        fit = fit_local(model, training, seed=seed, sweeps=SWEEPS, preparation=preparation)
    else:
        fit = fit_map(
            model, training, seed=seed, starts=1, keep=1, max_steps=FULL_STEPS,
            preparation=preparation,
        )  # fmt: skip
    return with_deviation(fit)


def errors(encoding: CycleEncoding, made: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Distance in mm (T, 17) of every joint from where it is."""
    return np.linalg.norm(encoding.positions(made) - encoding.positions(true), axis=-1)


def summary(values: list[float]) -> list[float]:
    """Mean and standard error over cycles."""
    spread = np.std(values, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else 0.0
    return [float(np.mean(values)), float(spread)]


@dataclass(frozen=True)
class Contest:
    """The trained models, the baselines and the test cycles."""

    walks: Walks
    trained: dict[str, Trained]

    def layered(self) -> Float[np.ndarray, "n d"]:
        """Training features of all three scales, which the baselines are given."""
        return np.asarray(self.trained["torus3"].training.frames.y)

    def interpolation(self, scale: str) -> dict[str, list[float]]:
        """Errors of representing whole cycles."""
        cycles, encoding = self.walks.test[scale], self.walks.encoding
        made = {
            name: [interpolate(one, cycle).mean for cycle in cycles]
            for name, one in self.trained.items()
        }
        made |= self.baselines(cycles, np.ones(cycles.shape[1:], bool))
        return {
            name: summary([
                float(errors(encoding, pose, cycle).mean())
                for pose, cycle in zip(poses, cycles, strict=True)
            ])
            for name, poses in made.items()
        }  # fmt: skip

    def baselines(self, cycles: np.ndarray, seen: np.ndarray) -> dict[str, list[np.ndarray]]:
        """Principal components and nearest poses by what is seen."""
        y = self.layered()
        pca = fit_pca(y, COMPONENTS)
        return {
            "pca": [pca.fill(cycle, seen) for cycle in cycles],
            "nearest": [nearest_pose(y, cycle, seen) for cycle in cycles],
        }

    def reconstruction(self, case: str, scale: str) -> dict[str, dict]:
        """Errors at the joints that move with the missing ones, and how often intervals hold.

        ``error`` is by eq. 15 with deviations that features do not share, as in the paper;
        ``error_shared`` with those of `learn_deviation`, whose intervals are counted.
        """
        cycles, encoding = self.walks.test[scale], self.walks.encoding
        columns = limb_columns(next(iter(self.trained.values())), CASES[case])
        joints = moved_joints(columns)
        seen = np.ones(cycles.shape[1:], bool)
        seen[:, columns] = False

        def error(poses) -> list[float]:
            # Joints that are seen stay as they are.
            filled = [
                np.where(seen, cycle, pose) for pose, cycle in zip(poses, cycles, strict=True)
            ]
            return summary([
                float(errors(encoding, pose, cycle)[:, joints].mean())
                for pose, cycle in zip(filled, cycles, strict=True)
            ])  # fmt: skip

        out: dict[str, dict] = {"error": {}, "error_shared": {}, "coverage90": {}}
        for name, one in self.trained.items():
            plain = white_deviation(np.asarray(one.deviation.white), cycles.shape[1])
            given = [without(cycle, columns) for cycle in cycles]
            found = [one.represent(part) for part in given]
            pairs = list(zip(found, given, strict=True))
            white = [pose_given(path, part, plain) for path, part in pairs]
            shared = [pose_given(path, part, one.deviation) for path, part in pairs]
            out["error"][name] = error([pose.mean for pose in white])
            out["error_shared"][name] = error([pose.mean for pose in shared])
            inside = [
                np.abs(pose.mean - cycle)[:, columns] <= 1.6449 * pose.sd[:, columns]
                for pose, cycle in zip(shared, cycles, strict=True)
            ]
            out["coverage90"][name] = float(np.mean(inside))
        for name, poses in self.baselines(cycles, seen).items():
            out["error"][name] = out["error_shared"][name] = error(poses)
        return out

    def filtering(self, noise: float, scale: str, seed: int) -> dict[str, list[float]]:
        """Errors after taking noise of unknown level out, mean over the repeats."""
        cycles, encoding = self.walks.test[scale], self.walks.encoding
        place = list(self.walks.test).index(scale)
        random = np.random.default_rng([seed, round(1000 * noise), place])
        training = encoding.scaled(self.walks.training).reshape(-1, *cycles.shape[1:])
        window = best_window(training, _noisy(training, noise, random))
        every = np.ones(cycles.shape[1:], bool)
        found: dict[str, list[list[float]]] = {}
        for _ in range(REPEATS):
            noisy = _noisy(cycles, noise, random)
            made = {
                name: [denoise(one, u)[0].mean for u in noisy] for name, one in self.trained.items()
            }
            made |= self.baselines(noisy, every)
            made |= {"savgol": [smoothed(u, window) for u in noisy], "noisy": list(noisy)}
            for name, poses in made.items():
                apart = [
                    float(errors(encoding, pose, cycle).mean())
                    for pose, cycle in zip(poses, cycles, strict=True)
                ]
                found.setdefault(name, []).append(apart)
        return {name: summary(np.mean(values, axis=0).tolist()) for name, values in found.items()}


def _noisy(
    cycles: Float[np.ndarray, "c t d"], noise: float, random: np.random.Generator
) -> Float[np.ndarray, "c t d"]:
    """Add noise of a share of each angle's standard deviation along its cycle."""
    spread = cycles.std(axis=1, keepdims=True)
    return cycles + noise * spread * random.standard_normal(cycles.shape)


def held_out(walks: Walks, fits: Mapping[str, Fit]) -> dict[str, Any]:
    """Log density of test cycles' left side given the rest: what a topology is worth."""
    trained = {name: trained_of(fit) for name, fit in fits.items()}
    columns = limb_columns(trained["torus"], CASES["left side"])
    cycles = walks.test["1"]
    density = {
        name: np.array([held_out_density(one, cycle, columns) for cycle in cycles])
        for name, one in trained.items()
    }
    entries = cycles.shape[1] * len(columns)
    return {
        "per_entry": {name: summary((d / entries).tolist()) for name, d in density.items()},
        "against_none": {
            name: summary(((d - density["none"]) / entries).tolist())
            for name, d in density.items()
            if name != "none"
        },
        "log_density": {name: float(fit.stats()["lp"]) for name, fit in fits.items()},
    }


class Stages:
    """What of the result is there already, and the file it is written to."""

    def __init__(self, path: Path, settings: dict[str, Any], say: Say) -> None:
        self.path, self.say = path, say
        self.result: dict[str, Any] = {"settings": settings, "seconds": {}}
        if path.is_file():
            old = json.loads(path.read_text(encoding="utf-8"))
            # Results of other settings are done again.
            if old.get("settings") == settings:
                self.result = old

    def do(self, *keys: str, work: Callable[[], Any]) -> Any:
        """Do a stage unless it is there, under the keys one within the other."""
        place = self.result
        for key in keys[:-1]:
            place = place.setdefault(key, {})
        if keys[-1] not in place:
            began = time.perf_counter()
            place[keys[-1]] = work()
            seconds = time.perf_counter() - began
            self.result["seconds"][" ".join(keys)] = seconds
            write_json(self.path, self.result)
            self.say(f"{' '.join(keys)}: {seconds:.0f} s")
        return place[keys[-1]]


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict:
    """Train the models, compare them, and write ``gait-pose.json`` and pictures to `out`.

    Parameters
    ----------
    data
        Folder that holds ``cmu/``; where None as in `bayesmotion.motion.datasets.cmu`. The
        BVH releases of four trials must be there.
    out
        Folder for the results and the fits.
    say
        Called with a line after every stage.
    seed
        Of the patches and of the noise.
    """
    from .gait_pose_learning import compare_learning, step_cost
    from .gait_pose_pictures import draw_gait_pictures

    walks = read_walks(data)
    stages = Stages(out / "gait-pose.json", plan(walks, seed), say)
    fits = {
        name: _kept(
            out / "fits" / f"{name}.nc", stages, lambda n=name: train(n, walks.training, seed)
        )
        for name in MODELS
    }
    contest = Contest(walks, {name: trained_of(fit) for name, fit in fits.items()})
    for scale in walks.test:
        stages.do("interpolation", scale, work=lambda s=scale: contest.interpolation(s))
    for case in CASES:
        for scale in walks.test:
            found = stages.do(
                "reconstructions", case, scale,
                work=lambda c=case, s=scale: contest.reconstruction(c, s),
            )  # fmt: skip
            for part, name in (
                ("error", "reconstruction"), ("error_shared", "reconstruction_shared"),
                ("coverage90", "coverage90"),
            ):  # fmt: skip
                stages.result.setdefault(name, {}).setdefault(case, {})[scale] = found[part]
    for noise in NOISES:
        for scale in walks.test:
            stages.do(
                "filtering", f"{noise:g}", scale,
                work=lambda n=noise, s=scale: contest.filtering(n, s, seed),
            )  # fmt: skip
    stages.do("held_out", work=lambda: _topologies(walks, out, stages, seed))
    stages.do("learning", work=lambda: compare_learning(walks.training, SIGMA, seed))
    stages.do("step_milliseconds", work=lambda: step_cost(seed))
    write_json(stages.path, stages.result)
    draw_gait_pictures(contest, fits, out)
    return stages.result


def plan(walks: Walks, seed: int) -> dict[str, Any]:
    """The settings of the study, and the cycles it took."""
    return {
        "training": dict(TRAINING),
        "test": dict(TEST),
        "strides": dict(STRIDES),
        "training_cycles": len(split(walks.training)),
        "training_subjects": sorted(set(walks.training["subject"].values.tolist())),
        "scales": list(SCALES),
        "sigma": SIGMA,
        "sweeps": SWEEPS,
        "full_steps": FULL_STEPS,
        "repeats": REPEATS,
        "seed": seed,
    }


def _kept(path: Path, stages: Stages, make: Callable[[], Fit]) -> Fit:
    """Read a fit that is there, else make it and keep it."""
    done = stages.result.setdefault("training", {})
    if path.is_file() and path.stem in done:
        return load(path)
    fit = make()
    fit.save(path)
    stats = fit.stats()
    done[path.stem] = {
        "seconds": float(fit.tree.attrs["seconds"]),
        "log_density": stats["lp"],
        "converged": bool(stats["converged"]) if "converged" in stats else None,
    }
    write_json(stages.path, stages.result)
    stages.say(f"{path.stem}: log density {stats['lp']:.0f}")
    return fit


def _topologies(walks: Walks, out: Path, stages: Stages, seed: int) -> dict[str, Any]:
    """Fit one layer with each topology and none, and compare held-out densities."""

    def make(model: GaitPose) -> Fit:
        fit = fit_map(model, walks.training, seed=seed, starts=1, keep=1, max_steps=FULL_STEPS)
        return with_deviation(fit)

    fits = {
        name: _kept(out / "fits" / f"one_layer_{name}.nc", stages, lambda m=model: make(m))
        for name, model in TOPOLOGIES.items()
    }
    return held_out(walks, fits)
