"""Keyposes of 13 dances with known beats (Tang, Jia and Mao 2018), against controls.

The recordings hold 23 joint positions at 25 frames a second, seen from the root, the root's
path, and beats at frames 12.5 k. Nothing is learned from them: candidates are kept by the
median depth of a dance's minima (T_2) alone.

beats   share of beats near which (2 frames) the energy is lower than in the whole beat around
        them, against the same after random circular shifts of the beats, and the mean energy
        at the beats over that of the dance
pca     variance that three principal components of the keyposes cover, and root mean square
        error of all frames in their space, against as many poses at equal steps (mean over
        OFFSETS places of the first one)
music   beats tracked in two recordings of the music against the grid, against random shifts
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...inference.density import ProgramDensity
from ...inference.optimisation.optimise import maximise
from ...models.keyposes.energy import Thresholds, body_centred, minima_near
from ...models.keyposes.flows import flows
from ...models.keyposes.rule import KeyposeFrames, select
from ...motion.datasets.fetching import folders
from ...sensing.audio.beats import onset_strength, track_beats
from ...tasks.low_dimensional import Components, components
from .pca import ProbabilisticPCA, uniform_frames

FILE = "tang2018_chacha_rumba.npz"
MUSIC = ("DANCE_C_8", "DANCE_R_2")
FRAME_RATE = 25.0
FRAMES_A_BEAT = 12.5
HIPS_AND_WAIST = (7, 16, 2)
NEAR = 2.0
OFFSETS = 10
SHIFTS = 200
PROBABILISTIC = 3  # dances for which probabilistic PCA is set beside the classical one
MATCH = 0.07  # seconds, as usual in the evaluation of beat tracking


def dance_plan() -> dict[str, Any]:
    """The settings of this part of the study."""
    return {
        "file": FILE,
        "music": list(MUSIC),
        "frame_rate": FRAME_RATE,
        "frames_a_beat": FRAMES_A_BEAT,
        "hips_and_waist": list(HIPS_AND_WAIST),
        "near": NEAR,
        "offsets": OFFSETS,
        "shifts": SHIFTS,
        "probabilistic": PROBABILISTIC,
        "match": MATCH,
    }


def place(data: Path | None) -> Path:
    """Give the folder of the dances.

    Raises
    ------
    InputError
        If the file is not in any of the usual places.
    """
    places = folders("dance", data / "dance" if data is not None else None)
    for folder in places:
        if (folder / FILE).is_file():
            return folder
    raise InputError(
        "dances",
        f"there is no {FILE} in {', '.join(map(str, places))}",
        "Put it there, or name the folder that holds dance/",
    )


def read_dances(data: Path | None) -> dict[str, dict[str, np.ndarray]]:
    """Read the dances: for each its ``position`` (N, 23, 3), ``span`` and ``n_beats``.

    Raises
    ------
    InputError
        If the file is not there.
    """
    with np.load(place(data) / FILE) as file:
        names = sorted({key.split("/")[0] for key in file})
        return {
            name: {
                "position": (file[f"{name}/skeletons"] + file[f"{name}/center"][:, None]).astype(
                    float
                ),
                "span": file[f"{name}/music_start_end_frames_25fps"] / FRAME_RATE,
                "n_beats": file[f"{name}/n_beats"],
            }
            for name in names
        }


def keyposes(flow: tuple[np.ndarray, np.ndarray], beats: np.ndarray) -> KeyposeFrames:
    """Give the keyposes of a dance; T_2 is the median depth of the minima near the beats."""
    near = [minima_near(part, beats, FRAMES_A_BEAT / 2) for part in flow]
    limits = [Thresholds(-np.inf, float(np.nanmedian(part.depth))) for part in near]
    return select(near[0], near[1], (limits[0], limits[1]))


def low_at(flow: np.ndarray, where: np.ndarray) -> float:
    """Give the share of moments with less energy near them than in the beat around them."""
    total = np.concatenate([[0.0], np.cumsum(flow)])

    def mean(half: float) -> np.ndarray:
        first = np.clip(np.round(where - half).astype(int), 0, len(flow) - 1)
        last = np.clip(np.round(where + half).astype(int) + 1, 1, len(flow))
        return (total[last] - total[first]) / (last - first)

    return float(np.mean(mean(NEAR) < mean(FRAMES_A_BEAT / 2)))


def at_beats(flow: tuple[np.ndarray, np.ndarray], seed: int) -> dict[str, Any]:
    """Give the share of beats with low energy, and that of randomly shifted beats."""
    frames = len(flow[0])
    beats = np.arange(0.0, frames - 1, FRAMES_A_BEAT)
    random = np.random.default_rng(seed)
    shifts = random.uniform(0, frames, SHIFTS)
    found: dict[str, Any] = {}
    for name, part in zip(("global", "body"), flow, strict=True):
        control = np.array([low_at(part, np.sort((beats + s) % (frames - 1))) for s in shifts])
        found[name] = {
            "share": low_at(part, beats),
            "control": float(control.mean()),
            "control_sd": float(control.std()),
            "control_draws": control.tolist(),
            "energy_at_beats": float(np.mean(part[np.round(beats).astype(int)]) / part.mean()),
        }
    return found


def pool(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Give the mean share over all dances against that of all dances shifted together."""
    control = np.mean([row.pop("control_draws") for row in rows], axis=0)
    share = float(np.mean([row["share"] for row in rows]))
    return {
        "share": share,
        "control": float(control.mean()),
        "control_sd": float(control.std()),
        "control_largest": float(control.max()),
    }


def pca(position: Float[np.ndarray, "n j 3"], found: KeyposeFrames) -> dict[str, Any]:
    """Compare components of keyposes with those of as many uniformly sampled poses."""
    poses = body_centred(position, *HIPS_AND_WAIST).reshape(len(position), -1)
    of_keyposes = components(poses[found.frame])
    uniform = [
        components(poses[uniform_frames(len(poses), len(found.frame), offset)])
        for offset in (np.arange(OFFSETS) + 0.5) / OFFSETS
    ]

    def error(space: Components) -> float:
        gap = space.low_dimensional(poses, 3) - poses
        return float(np.sqrt(np.square(gap).mean() * 3.0))

    curves = np.array([space.covered()[:10] for space in uniform])
    return {
        "n": len(found.frame),
        "keypose": of_keyposes.covered()[:10].tolist(),
        "uniform": curves.mean(axis=0).tolist(),
        "keypose_error_cm": error(of_keyposes),
        "uniform_error_cm": float(np.mean([error(space) for space in uniform])),
    }


def probabilistic(position: Float[np.ndarray, "n j 3"], found: KeyposeFrames) -> dict[str, float]:
    """Fit probabilistic PCA (Q = 3) to keyposes in the space of their first ten components.

    Gives how far its W W^T is from the classical solution, relative to it.
    """
    poses = body_centred(position, *HIPS_AND_WAIST).reshape(len(position), -1)[found.frame]
    space = components(poses)
    y = (poses - space.mean) @ space.basis[:, :10]
    y = y / y.std()
    variance = np.linalg.eigvalsh(y.T @ y / len(y))[::-1]
    random = np.random.default_rng(0)
    starts = {
        "mean": np.zeros((2, 10)),
        "W": 0.5 * random.normal(size=(2, 10, 3)),
        "log_noise": np.zeros(2),
    }
    found_mode = maximise(
        ProgramDensity(ProbabilisticPCA(3)), starts, (y,), max_steps=500,
        tolerance=1e-12,
    ).best()  # fmt: skip
    left = np.linalg.eigh(y.T @ y / len(y))[1][:, ::-1][:, :3]
    noise = variance[3:].mean()
    classical = left * (variance[:3] - noise) @ left.T
    gap = found_mode["W"] @ found_mode["W"].T - classical
    return {
        "relative_difference": float(np.linalg.norm(gap) / np.linalg.norm(classical)),
        "noise": float(np.exp(2.0 * found_mode["log_noise"])),
        "noise_classical": float(noise),
    }


def run(dances: dict[str, dict[str, np.ndarray]], seed: int) -> dict[str, Any]:
    """Give all numbers of the dances."""
    beats, spaces, ppca = {}, {}, {}
    for index, (name, dance) in enumerate(dances.items()):
        flow = flows(dance["position"], FRAME_RATE, HIPS_AND_WAIST)
        grid = np.arange(0.0, len(flow[0]) - 1, FRAMES_A_BEAT)
        found = keyposes(flow, grid)
        beats[name] = at_beats(flow, seed)
        spaces[name] = pca(dance["position"], found)
        if index < PROBABILISTIC:
            ppca[name] = probabilistic(dance["position"], found)
    pooled = {name: pool([rows[name] for rows in beats.values()]) for name in ("global", "body")}
    above = sum(row["global"]["share"] > row["global"]["control"] for row in beats.values())
    wins = sum(row["keypose"][2] > row["uniform"][2] for row in spaces.values())
    closer = sum(row["keypose_error_cm"] < row["uniform_error_cm"] for row in spaces.values())
    return {
        "beats": {"dances": beats, "pooled": pooled, "more_than_control": above},
        "pca": {
            "dances": spaces,
            "keypose_covers_more": wins,
            "keypose_error_smaller": closer,
            "probabilistic": ppca,
        },
    }


def music(data: Path | None, dances: dict[str, dict[str, np.ndarray]], seed: int) -> dict[str, Any]:
    """Compare tracked beats with the grid of the dances whose music is there."""
    random = np.random.default_rng(seed)
    result = {}
    for name in MUSIC:
        path = place(data) / f"{name}_audio.mp3"
        if path.is_file():
            first, last = dances[name]["span"]
            result[name] = against_grid(path, first, last, int(dances[name]["n_beats"]), random)
    return result


def against_grid(
    path: Path, first: float, last: float, count: int, random: np.random.Generator
) -> dict[str, Any]:
    """Compare beats tracked in music with `count` beats spread evenly from `first` to `last`.

    A control shifts the grid at random by up to half a beat. The strength of onsets at the
    grid, against the control's and that at the tracked beats, tells whether the grid fits the
    music at all, whatever a tracker finds.

    Returns
    -------
    Tempi of both, and how far tracked beats are from an even tempo (root mean square);
    share of the grid's beats with a tracked one near, the same for the control; and the same
    for the mean onset strength.
    """
    tracked = track_beats(path)
    time, strength = onset_strength(path)
    period = (last - first) / count
    grid = first + np.arange(count) * period
    inside = tracked[(tracked >= first - period) & (tracked < last + period)]
    shifts = random.uniform(-0.5 * period, 0.5 * period, SHIFTS)

    def matched(shift: float) -> float:
        return float(np.mean(np.abs(grid[:, None] + shift - inside).min(axis=1) < MATCH))

    def loud(shift: float) -> float:
        return float(np.interp(grid + shift, time, strength).mean())

    def compared(measure: Callable[[float], float]) -> dict[str, float]:
        control = np.array([measure(shift) for shift in shifts])
        at_grid = measure(0.0)
        return {
            "at_grid": at_grid,
            "control": float(control.mean()),
            "control_largest": float(control.max()),
            "control_share_above": float(np.mean(control >= at_grid)),
        }

    number = np.arange(len(inside))
    line = np.polyfit(number, inside, 1)
    return {
        "tempo_tracked": float(60.0 / line[0]),
        "tracked_from_even_ms": float(1000.0 * np.std(inside - np.polyval(line, number))),
        "tempo_grid": float(60.0 / period),
        "n_tracked": len(inside),
        "n_grid": count,
        "matched": compared(matched),
        "onsets": compared(loud) | {"at_tracked": float(np.interp(inside, time, strength).mean())},
    }
