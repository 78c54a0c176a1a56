"""How the gait-pose study compares models: errors in millimetres, coverage, densities."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ...fit import Fit
from ...models.gait_pose.encoding import CycleEncoding
from ...prediction import Mixture
from ...tasks.gait import (
    LIMBS,
    Trained,
    denoise,
    held_out_density,
    interpolate,
    limb_columns,
    mixture_of_poses,
    moved_joints,
    trained_of,
    without,
)
from ...tasks.latent import LatentPath, Measured
from ...tasks.pose_baselines import best_window, fit_pca, nearest_pose, smoothed
from ...tasks.pose_posterior import SubjectResidual, pose_given, white_residual
from .walks import Walks

CASES = {"left arm": ("larm",), "left leg": ("lleg",), "left side": ("larm", "lleg")}
NOISES = (0.05, 0.10, 0.15)
REPEATS = 1
COMPONENTS = 3


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
            name: [interpolate(one, cycle).means() for cycle in cycles]
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

        ``error`` is by eq. 15 with residuals that features do not share, as in the paper;
        ``error_shared`` with those of `learn_subject_residual`, whose intervals are counted.
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
            poses = cycles.shape[1]
            plain = white_residual(one.residual.white(poses), poses)
            given = [without(cycle, columns) for cycle in cycles]
            found = [one.infer_paths(part) for part in given]
            pairs = list(zip(found, given, strict=True))
            white = [_over_draws(paths, part, plain) for paths, part in pairs]
            own = one.residual_without(columns)
            shared = [_over_draws(paths, part, own) for paths, part in pairs]
            out["error"][name] = error([poses.means() for poses in white])
            out["error_shared"][name] = error([poses.means() for poses in shared])
            inside = [
                np.abs(poses.probability(cycle) - 0.5)[:, columns] <= 0.45
                for poses, cycle in zip(shared, cycles, strict=True)
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
                name: [denoise(one, u)[0].means() for u in noisy]
                for name, one in self.trained.items()
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


def _over_draws(paths: Sequence[LatentPath], given: Measured, residual: SubjectResidual) -> Mixture:
    """Return the poses of a cycle, averaged over draws."""
    return mixture_of_poses([pose_given(path, given, residual) for path in paths])


def _noisy(
    cycles: Float[np.ndarray, "c t d"], noise: float, random: np.random.Generator
) -> Float[np.ndarray, "c t d"]:
    """Add noise of a share of each angle's standard deviation along its cycle."""
    spread = cycles.std(axis=1, keepdims=True)
    return cycles + noise * spread * random.standard_normal(cycles.shape)


def swings(walks: Walks) -> dict[str, dict[str, list[float]]]:
    """How far limbs swing in the recorded long strides, in what they do in training cycles.

    For every limb the root mean square of its angles about their means over the cycle, mean
    over the strides and the largest, in that of the middle training cycle as recorded; and
    that of the training cycle that swings it most.
    """
    encoding = walks.encoding
    training = encoding.scaled(walks.training).reshape(-1, *walks.test["stride"].shape[1:])
    out = {}
    for limb, joints in LIMBS.items():
        columns = encoding.columns(joints)

        def swing(cycles: np.ndarray, columns: list[int] = columns) -> np.ndarray:
            return np.sqrt(cycles[:, :, columns].var(axis=1).sum(axis=1))

        known, strides = swing(training), swing(walks.test["stride"])
        middle = float(np.median(known))
        out[limb] = {
            "strides": [float(strides.mean()) / middle, float(strides.max()) / middle],
            "training": [1.0, float(known.max()) / middle],
        }
    return out


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
