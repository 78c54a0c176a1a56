"""Noise taken out of real recordings by Gaussian processes in time (`bm.denoise`).

White noise of 1, 3 and 5 degrees is added to all angles of twenty CMU trials of ten people, and
taken out again: by the sd of the noise, and without knowing it. Beside that stands the filter of
gait laboratories, a Butterworth filter of 6 Hz forwards and backwards, and the same filter with
the cut-off that is best for training trials at that noise. The error is the mean distance in
millimetres of joints from where they are, over joints and frames, with the root's path as it was
recorded.

Whether angles are smoothed in bases in which they move by themselves, and in how long stretches
(`gp.series.Settings`), is chosen on other trials, all but one of four other people; so were the
grid's ends and the thresholds of the bases, by hand.
"""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...gp.gaps import smooth_series
from ...gp.series import SETTINGS, Settings, lowpass
from ...motion.dataset import skeleton_of
from ...motion.filters import unwrapped
from ...motion.kinematics import poses
from ...tasks.denoise import denoise
from ...tasks.recording import Denoised
from ..stages import Say, Stages
from ..trials import read_trial

TRAINING = ("02_03", "02_04", "05_12", "07_01", "07_11", "08_08", "08_11", "35_05", "35_17")
TEST = (
    "03_01", "05_02", "05_10", "05_18", "06_01.bvh", "09_03", "09_12", "10_04.bvh", "12_02",
    "16_05", "16_11", "16_31", "16_53", "27_01.bvh", "32_01.bvh", "49_02", "49_06", "49_09",
    "49_17", "131_04",
)  # fmt: skip
NOISES_DEGREES = (1.0, 3.0, 5.0)
LABORATORY_HZ = 6.0
CUTOFFS_HZ = (2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0, 7.0, 8.0, 10.0)
# What is tried on the training trials: no bases, and how long stretches are.
VARIANTS: dict[str, dict[str, float | None]] = {
    "each angle alone, 1.5 s": {"velocity_threshold": None, "fast_threshold": None},
    "bases, 1.5 s": {},
    "bases, 4 s": {"stretch_s": 4.0},
    "bases, whole recordings": {"stretch_s": 1e6},
}
# CMU's unit in metres, which its BVH release does not tell.
UNIT_M = 0.0254 / 0.45
SHARES = (0.5, 0.9)


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict[str, Any]:
    """Choose on the training trials, take noise out of the others, write ``denoising.json``.

    Parameters
    ----------
    data
        Folder that holds ``cmu/``; where None as in `bayesmotion.motion.datasets.public.cmu`. The
        BVH releases of four trials must be there.
    out
        Folder for the results.
    say
        Called with a line after every stage.
    seed
        Of the noise.
    """
    stages = Stages(out / "denoising.json", plan(seed), say)
    for noise in NOISES_DEGREES:
        stages.do("cutoff_hz", f"{noise:g}", work=lambda d=noise: cutoffs(data, d, seed))
    for name in VARIANTS:
        stages.do("variants", name, work=lambda n=name: chosen_by(data, n, seed))
    for trial in TEST:
        motion = read_trial(trial, data)
        stages.read(**{trial: motion})
        for noise in NOISES_DEGREES:
            cutoff = best_cutoff(stages.result, noise)
            stages.do(
                "trials", trial, f"{noise:g}",
                work=lambda m=motion, d=noise, c=cutoff: contest(m, d, c, seed),
            )  # fmt: skip
    return stages.result


def plan(seed: int = 0) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "training": list(TRAINING),
        "test": list(TEST),
        "noises_degrees": list(NOISES_DEGREES),
        "laboratory_hz": LABORATORY_HZ,
        "cutoffs_hz": list(CUTOFFS_HZ),
        "variants": VARIANTS,
        "smoothing": asdict(SETTINGS),
        "seed": seed,
    }


def cutoffs(data: Path | None, noise: float, seed: int) -> dict[str, float]:
    """Return the mean error (mm) over training trials of every cut-off (Hz)."""
    found: dict[str, list[float]] = {f"{hz:g}": [] for hz in CUTOFFS_HZ}
    for trial in TRAINING:
        motion = read_trial(trial, data)
        noisy = unwrapped(with_noise(motion, noise, seed)["angle"].values)
        for hz, name in zip(CUTOFFS_HZ, found, strict=True):
            found[name].append(error_mm(motion, lowpass(noisy, hz, rate_of(motion))))
    return {name: float(np.mean(errors)) for name, errors in found.items()}


def best_cutoff(result: Mapping[str, Any], noise: float) -> float:
    """Return the cut-off (Hz) that is best for the training trials."""
    errors = result["cutoff_hz"][f"{noise:g}"]
    return float(min(errors, key=errors.get))


def chosen_by(data: Path | None, name: str, seed: int) -> dict[str, float]:
    """Return the mean error (mm) over training trials at every noise of a variant."""
    settings = settings_of(name)
    found = {}
    for noise in NOISES_DEGREES:
        errors = []
        for trial in TRAINING:
            motion = read_trial(trial, data)
            noisy = unwrapped(with_noise(motion, noise, seed)["angle"].values)
            made = smooth_series(noisy, rate_of(motion), float(np.deg2rad(noise)), settings)
            errors.append(error_mm(motion, made.mean.mean(axis=0)))
        found[f"{noise:g}"] = float(np.mean(errors))
    return found


def settings_of(name: str) -> Settings:
    """Return the settings of a variant."""
    changed: dict[str, Any] = dict(VARIANTS[name])
    return replace(SETTINGS, **changed)


def best_variant(result: Mapping[str, Any]) -> str:
    """Return the variant of least error, relative to the first one, in the mean over noises."""
    errors = result["variants"]
    first = next(iter(errors.values()))
    return min(errors, key=lambda name: np.mean([errors[name][d] / first[d] for d in first]))


def contest(motion: xr.Dataset, noise: float, cutoff: float, seed: int) -> dict[str, Any]:
    """Return errors (mm), coverage, the noise found (degrees) and seconds of one trial."""
    noisy = with_noise(motion, noise, seed)
    angle, rate = unwrapped(noisy["angle"].values), rate_of(motion)
    began = perf_counter()
    known = denoise(noisy, noise_degrees=noise)
    between = perf_counter()
    estimated = denoise(noisy)
    ended = perf_counter()
    return {
        "frames": motion.sizes["frame"],
        "error_mm": {
            "measured": error_mm(motion, angle),
            "laboratory": error_mm(motion, lowpass(angle, LABORATORY_HZ, rate)),
            "best_cutoff": error_mm(motion, lowpass(angle, cutoff, rate)),
            "known": error_mm(motion, known.motion["angle"].values),
            "estimated": error_mm(motion, estimated.motion["angle"].values),
        },
        "coverage": {"known": coverage(known, motion), "estimated": coverage(estimated, motion)},
        "noise_degrees": estimated.noise_degrees,
        "seconds": {"known": between - began, "estimated": ended - between},
    }


def with_noise(motion: xr.Dataset, noise: float, seed: int) -> xr.Dataset:
    """Return a motion whose angles have white noise, other noise of every trial and level."""
    key = [seed, round(1000 * noise), *str(motion["clip"].values[0]).encode()]
    white = np.random.default_rng(key).normal(size=motion["angle"].shape)
    return motion.assign(angle=motion["angle"] + np.deg2rad(noise) * white)


def error_mm(motion: xr.Dataset, angle: Float[np.ndarray, "n d"]) -> float:
    """Return the mean distance in mm of joints from where they are, over joints and frames."""
    skeleton, root = skeleton_of(motion), motion["root_position"].values
    true, _ = poses(skeleton, motion["angle"].values, root)
    made, _ = poses(skeleton, angle, root)
    unit = UNIT_M if skeleton.metres is None else skeleton.metres
    return float(1000.0 * unit * np.linalg.norm(made - true, axis=-1).mean())


def coverage(made: Denoised, motion: xr.Dataset) -> dict[str, float]:
    """Return the shares of the angles without noise that are in their central intervals."""
    true = motion["angle"].sel(dof=list(made.dofs)).values
    off = (true - made.mean + np.pi) % (2 * np.pi) - np.pi
    away = np.abs(made.mixture.probability(made.mean + off) - 0.5)
    return {f"{100 * share:g}": float((away <= 0.5 * share).mean()) for share in SHARES}


def rate_of(motion: xr.Dataset) -> float:
    """Return the frames a second."""
    return float(motion.attrs["frame_rate"])
