"""Recordings of dances made into what the keypose model sees: the minima near their beats.

A recording is a motion with two variables more along ``frame``:

beat      the beats counted, as a real number that grows from frame to frame and is whole at
          the beats; NaN where there is no music (`with_beats`)
keypose   1 at keyposes, 0 elsewhere, NaN where nobody has looked (`with_keyposes`); without
          it nothing is known

Depths are logarithms, standardised over the minima of their own clip, so that dancers and
units of length do not matter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import Units
from ...motion.joining import split
from .energy import Minima, minima_near

ABSENT = -4.0
FlowsOf = Callable[[xr.Dataset], tuple[np.ndarray, np.ndarray]]
HALF = 0.5  # beats that are counted on before the first and after the last one


class KeyposeData(NamedTuple):
    """The minima near beats as the program sees them.

    in_global, in_body
        (B,) standardised log depths; `ABSENT` where that frame of reference has no minimum.
    offset
        (B,) seconds behind the beat.
    keypose
        (B, 1) 1 for a keypose, 0 for none or where unknown.
    known
        (B, 1) whether it is known.
    """

    in_global: Float[AnyArray, " b"]
    in_body: Float[AnyArray, " b"]
    offset: Float[AnyArray, " b"]
    keypose: AnyArray
    known: AnyArray


@dataclass(frozen=True)
class Recorded:
    """Recordings as the model sees them.

    minima
        The arrays for the program.
    clip, frame
        (B,) where each minimum is.
    """

    minima: KeyposeData
    clip: tuple[str, ...]
    frame: Int[np.ndarray, " b"]

    @property
    def data(self) -> tuple[KeyposeData]:
        """The arguments of the model's program."""
        return (self.minima,)

    def observed(self) -> xr.Dataset:
        """Return what the model explains: ``keypose`` (minimum, answer), NaN where unknown."""
        answer = np.where(np.asarray(self.minima.known), np.asarray(self.minima.keypose), np.nan)
        where = {"clip": ("minimum", list(self.clip)), "frame": ("minimum", self.frame)}
        return xr.Dataset(
            {"keypose": (("minimum", "answer"), answer)}, where | {"answer": ["keypose"]}
        )

    def constants(self) -> xr.Dataset:
        """Return what the answers are explained by."""
        names = ("in_global", "in_body", "offset")
        return xr.Dataset({n: ("minimum", np.asarray(getattr(self.minima, n))) for n in names})

    def units(self) -> dict[str, Units]:
        """Return the units: 0 and 1 have none."""
        return {"keypose": Units(np.zeros(1), np.ones(1))}


def with_beats(motion: xr.Dataset, beats: Float[np.ndarray, " b"]) -> xr.Dataset:
    """Return the clip with its beats counted.

    Parameters
    ----------
    motion
        One clip.
    beats
        Two or more times in seconds from the clip's first frame, growing.

    Raises
    ------
    InputError
        If there are fewer than two beats, or they do not grow.
    """
    if len(beats) < 2 or not (np.diff(beats) > 0).all():
        raise InputError(
            "beats", "there are fewer than two, or they do not grow", "Give seconds in order"
        )
    step = np.diff(beats)
    times = np.concatenate([[beats[0] - HALF * step[0]], beats, [beats[-1] + HALF * step[-1]]])
    counts = np.concatenate([[-HALF], np.arange(len(beats)), [len(beats) - 1 + HALF]])
    at = np.arange(motion.sizes["frame"]) / float(motion.attrs["frame_rate"])
    count = np.interp(at, times, counts, left=np.nan, right=np.nan)
    return motion.assign(beat=("frame", count))


def with_keyposes(motion: xr.Dataset, keyposes: Sequence[int]) -> xr.Dataset:
    """Return the clip with the frames of all its keyposes."""
    known = np.zeros(motion.sizes["frame"])
    known[np.asarray(keyposes, dtype=int)] = 1.0
    return motion.assign(keypose=("frame", known))


def beats_of(motion: xr.Dataset) -> Float[np.ndarray, " b"]:
    """Return the beats of one clip in frames, not necessarily whole.

    Raises
    ------
    InputError
        If the clip has no variable ``beat``, or fewer than two beats.
    """
    if "beat" not in motion or motion["beat"].dims != ("frame",):
        raise InputError(
            "keyposes", "the recording has no beat (frame)", "Add it: with_beats(motion, seconds)"
        )
    count = motion["beat"].values.astype(float)
    there = np.isfinite(count)
    if not there.any():
        return np.zeros(0)
    whole = np.arange(np.ceil(count[there].min() - 1e-9), np.floor(count[there].max() + 1e-9) + 1)
    return np.interp(whole, count[there], np.flatnonzero(there))


class ClipMinima(NamedTuple):
    """The minima of one clip; see `KeyposeData`, with the frame of each."""

    in_global: Float[np.ndarray, " b"]
    in_body: Float[np.ndarray, " b"]
    offset: Float[np.ndarray, " b"]
    frame: Int[np.ndarray, " b"]


def minima_of(
    flow: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]],
    beats: Float[np.ndarray, " b"],
    frame_rate: float,
    window: float | None,
) -> ClipMinima:
    """Return the minima near the beats of a clip.

    Parameters
    ----------
    flow
        Energy in the global and in the body's frame.
    beats
        In frames.
    frame_rate
        Frames a second.
    window
        Seconds around a beat; half the median time between beats where None.
    """
    if window is None:
        wide = HALF * float(np.median(np.diff(beats))) if len(beats) > 1 else 0.0
    else:
        wide = window * frame_rate
    near = [minima_near(part, beats, wide) for part in flow]
    return clip_minima(near[0], near[1], beats, frame_rate)


def clip_minima(
    in_global: Minima, in_body: Minima, beats: Float[np.ndarray, " b"], frame_rate: float
) -> ClipMinima:
    """Return the rows of the minima near beats (in frames).

    A beat without a minimum in either frame of reference has no row. The frame of a row is
    that of the global minimum where there is one.
    """
    frame = np.where(in_global.frame >= 0, in_global.frame, in_body.frame)
    kept = frame >= 0
    depths = []
    for log in (np.log(np.maximum(m.depth, 1e-9)) for m in (in_global, in_body)):
        there = log[np.isfinite(log)]
        scaled = (log - there.mean()) / max(float(there.std()), 1e-9) if len(there) else log
        depths.append(np.where(np.isfinite(scaled), np.maximum(scaled, ABSENT), ABSENT)[kept])
    offset = ((frame - beats) / frame_rate)[kept]
    return ClipMinima(depths[0], depths[1], offset, frame[kept])


def answers(
    frame: Int[np.ndarray, " b"], keypose: Float[np.ndarray, " n"], tolerance: float
) -> tuple[Float[np.ndarray, " b"], Bool[np.ndarray, " b"]]:
    """Return which minima are keyposes, and which answers are known.

    A minimum is a keypose if one is within the tolerance in frames; that it is none is known
    if all these frames were looked at.
    """
    far = int(np.floor(tolerance + 1e-9))
    near = [keypose[max(f - far, 0) : f + far + 1] for f in frame]
    yes = np.array([bool((part == 1.0).any()) for part in near], dtype=bool)
    looked = np.array([bool(np.isfinite(part).all()) for part in near], dtype=bool)
    return yes.astype(float), yes | looked


def recorded(
    recordings: xr.Dataset,
    flows: FlowsOf,
    window: float | None,
    tolerance: float,
) -> Recorded:
    """Make recordings into arrays.

    Parameters
    ----------
    recordings
        Clips with beats; see the module.
    flows
        Of one clip the energy in both frames of reference.
    window
        As for `minima_of`.
    tolerance
        Seconds between a minimum and its keypose.

    Raises
    ------
    InputError
        If fewer than two beats have a minimum.
    """
    rate = float(recordings.attrs["frame_rate"])
    parts: list[ClipMinima] = []
    answer: list[np.ndarray] = []
    known: list[np.ndarray] = []
    names: list[str] = []
    for clip, part in split(recordings).items():
        found = minima_of(flows(part), beats_of(part), rate, window)
        looked = np.full(part.sizes["frame"], np.nan)
        if "keypose" in part:
            looked = part["keypose"].values.astype(float)
        yes, told = answers(found.frame, looked, tolerance * rate)
        parts.append(found)
        answer.append(yes)
        known.append(told)
        names += [clip] * len(found.frame)
    if len(names) < 2:
        raise InputError(
            "keyposes",
            "fewer than two beats have a minimum",
            "Check the beats, or widen the window",
        )
    whole = ClipMinima(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    minima = KeyposeData(
        whole.in_global,
        whole.in_body,
        whole.offset,
        np.concatenate(answer)[:, None],
        np.concatenate(known)[:, None],
    )
    return Recorded(minima, tuple(names), whole.frame)
