"""Gaps cut into public recordings of markers and filled in again (`bm.fill_gaps`).

Four recordings, three of the CMU and one of HDM05, as Tits, Tilmanne and Dutoit (PLoS ONE 2018) use
them. In 1, 3 and 5 markers at random the same 0.5, 1 and 2 seconds are cut out, ten times each.
The error is the root mean square of the distance in mm over the positions that were cut out;
beside it are those of what others do (`baselines`), on the same gaps.
"""

from collections.abc import Mapping
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import xarray as xr

from ...errors import InputError
from ...motion.datasets.fetching import folders
from ...motion.io.c3d import read_c3d
from ...tasks.gaps import fill_gaps
from ..stages import Say, Stages
from .baselines import baselines

RECORDINGS = ("85_02", "85_12", "135_02", "HDM_mm_01-02_03_120")
SECONDS = (0.5, 1.0, 2.0)
MARKERS = (1, 3, 5)
REPETITIONS = 10
MARGIN = 20  # frames before and after a gap, at least
SHARES = (0.5, 0.8, 0.9, 0.95)


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict[str, Any]:
    """Fill in the gaps of every recording, and write ``gaps.json``.

    Parameters
    ----------
    data
        Folder that holds ``benchmarks/gaps``; where None the one that BAYESMOTION_DATA names.
    out
        Folder for the results.
    say
        Called with a line after every stage.
    seed
        Of the gaps.

    Raises
    ------
    InputError
        If the recordings are not there.
    """
    stages = Stages(out / "gaps.json", plan(seed), say)
    for name in RECORDINGS:
        recording = read_c3d(_folder(data) / f"{name}.c3d")
        stages.read(**{name: recording})
        for seconds in SECONDS:
            for markers in MARKERS:
                stages.do(
                    "gaps", name, f"{seconds:g}", f"{markers}",
                    work=lambda r=recording, s=seconds, m=markers: contest(r, s, m, seed),
                )  # fmt: skip
    return stages.result


def plan(seed: int = 0) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "recordings": list(RECORDINGS), "seconds": list(SECONDS), "markers": list(MARKERS),
        "repetitions": REPETITIONS, "margin": MARGIN,
        "shares": list(SHARES), "seed": seed,
    }  # fmt: skip


def contest(recording: xr.Dataset, seconds: float, markers: int, seed: int) -> dict[str, Any]:
    """Return errors (mm) of every way by repetition, coverage of intervals, and CPU seconds."""
    position, rate = recording["position"].values, float(recording.attrs["frame_rate"])
    mm = 1000.0 * float(recording.attrs["metres"])
    random = np.random.default_rng([seed, int(1000 * seconds), markers])
    errors: dict[str, list[float]] = {}
    covered: dict[str, list[float]] = {f"{share:g}": [] for share in SHARES}
    used = 0.0
    for _ in range(REPETITIONS):
        given, lost = cut(position, round(seconds * rate), markers, random)
        begun = process_time()
        found = fill_gaps(recording.assign(position=(recording["position"].dims, given)))
        used += process_time() - begun
        made = {"fill_gaps": found.motion["position"].values}
        made |= {name: fill(given) for name, fill in baselines().items()}
        for name, whole in made.items():
            errors.setdefault(name, []).append(mm * rms(whole[lost] - position[lost]))
        for share, kept in covered.items():
            low, high = found.interval(float(share))
            inside = (position >= low) & (position <= high)
            kept.append(float(inside[lost].mean()))
    return {"rms_mm": errors, "coverage": covered, "cpu_seconds": used / REPETITIONS}


def cut(
    position: np.ndarray, length: int, markers: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions with a gap at the same time in some markers, and which were cut out.

    Markers that are not seen in a frame of it, or just before and after, are not chosen.
    """
    frames = len(position)
    first = int(random.integers(MARGIN, frames - length - MARGIN))
    about = slice(first - 1, first + length + 1)
    whole = np.flatnonzero(np.isfinite(position[about]).all(axis=(0, 2)))
    chosen = random.choice(whole, markers, replace=False)
    given, lost = position.copy(), np.zeros(position.shape[:2], dtype=bool)
    lost[first : first + length, chosen] = True
    given[lost] = np.nan
    return given, lost


def rms(away: np.ndarray) -> float:
    """Return the root mean square of distances (n, 3)."""
    return float(np.sqrt(np.mean(np.sum(away**2, axis=-1))))


def errors_of(result: Mapping[str, Any], way: str, seconds: str, markers: str) -> np.ndarray:
    """Return the errors (mm) of one way over recordings and repetitions."""
    return np.concatenate([
        result["gaps"][name][seconds][markers]["rms_mm"][way] for name in result["gaps"]
    ])  # fmt: skip


def _folder(data: Path | None) -> Path:
    places = folders("benchmarks", None if data is None else data / "benchmarks")
    root = next((p / "gaps" for p in places if (p / "gaps").is_dir()), places[0] / "gaps")
    if not (root / f"{RECORDINGS[0]}.c3d").is_file():
        raise InputError(
            root, "the recordings of markers are not there",
            "Get the C3D files of github.com/numediart/MocapRecovery, and put them there",
        )  # fmt: skip
    return root
