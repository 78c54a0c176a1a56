"""A synthetic dance whose keyposes are known.

An adult moves from keypose to keypose; every keypose is held for an instant on a beat, and
between two of them all angles and the root's path follow the minimum jerk profile

    s(u) = 10 u^3 - 15 u^4 + 6 u^5,   u from 0 to 1

so that the energy is zero at the keyposes and, without noise, nowhere else. Keyposes come
on every beat or, at random, on every second one; the beats between them have none.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ...errors import InputError
from ..dataset import make_motion
from .anthropometry import adult_skeleton

FRAME_RATE = 60.0
STATURE = 1.7
SWING = 0.3  # standard deviation of a keypose's angles in radians
STEP = 0.5  # of the root's step in metres


@dataclass(frozen=True)
class Dance:
    """A synthetic dance.

    motion
        One clip in metres.
    beats
        (B,) times of the beats in seconds.
    keyposes
        (K,) frames of the keyposes.
    """

    motion: xr.Dataset
    beats: Float[np.ndarray, " b"]
    keyposes: Int[np.ndarray, " k"]


def synthetic_dance(
    seed: int,
    *,
    beats: int = 32,
    tempo: float = 100.0,
    noise: float = 0.0,
    drift: float = 0.0,
    skipped: float = 0.4,
) -> Dance:
    """Make a dance.

    Parameters
    ----------
    seed
        Of the keyposes, the beats they are on, the noise and the drift.
    beats
        Number of beats.
    tempo
        Beats a minute.
    noise
        Standard deviation in radians of white noise on every angle.
    drift
        How far the dancer strays from the music: standard deviation in seconds of the
        keyposes' distances from their beats.
    skipped
        Probability that a beat after a keypose has none.

    Raises
    ------
    InputError
        If there are fewer than four beats, or a number is negative.
    """
    if beats < 4 or tempo <= 0 or noise < 0 or drift < 0 or not 0 <= skipped < 1:
        raise InputError(
            "synthetic dance",
            f"{beats} beats at {tempo}, noise {noise}, drift {drift}, skipped {skipped}",
            "Ask for four beats or more, and for numbers that are not negative",
        )
    random = np.random.default_rng(seed)
    period = 60.0 / tempo
    on = [1]
    while on[-1] < beats - 1:
        on.append(on[-1] + 1 + int(random.random() < skipped))
    held = np.array([b for b in on if b < beats])
    times = period * (held + 0.5)
    shift = np.clip(drift * random.normal(size=len(held)), -0.4 * period, 0.4 * period)
    frames = np.round((times + shift) * FRAME_RATE).astype(int)
    total = int(period * (beats + 0.5) * FRAME_RATE) + 1
    skeleton = adult_skeleton("dancer", STATURE)
    angle = _path(random, frames, total, len(skeleton.dofs), SWING)
    angle += noise * random.normal(size=angle.shape)
    root = np.cumsum(_steps(random, len(held) + 2), axis=0) + np.array([0.0, 0.9, 0.0])
    motion = make_motion(
        skeleton,
        angle,
        _between(root, frames, total),
        frame_rate=FRAME_RATE,
        clip=f"dance_{seed}",
        source="synthetic dance",
    )
    return Dance(motion, period * (np.arange(beats) + 0.5), frames)


def _path(
    random: np.random.Generator, frames: np.ndarray, total: int, columns: int, spread: float
) -> np.ndarray:
    """Go from one random keypose to the next; also from before the first and after the last."""
    return _between(spread * random.normal(size=(len(frames) + 2, columns)), frames, total)


def _steps(random: np.random.Generator, count: int) -> np.ndarray:
    steps = STEP * random.normal(size=(count, 3))
    steps[:, 1] *= 0.1
    return steps


def _between(values: np.ndarray, frames: np.ndarray, total: int) -> np.ndarray:
    """Give minimum jerk paths through values at frames, the first and last one at the ends."""
    ends = np.concatenate([[0], frames, [total - 1]])
    out = np.empty((total, values.shape[1]))
    for k, (first, last) in enumerate(itertools.pairwise(ends)):
        u = np.linspace(0.0, 1.0, last - first + 1)[:, None]
        profile = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        out[first : last + 1] = values[k] + (values[k + 1] - values[k]) * profile
    return out
