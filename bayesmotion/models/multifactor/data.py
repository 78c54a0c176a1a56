"""Clips made into what the multifactor program is given, and predictions into motions again."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...model import Units
from ...motion.dataset import skeleton_of
from ...motion.joining import concat, split
from ...motion.size import Lengths
from ...motion.skeleton import Skeleton
from .encoding import PoseEncoding, learn_encoding
from .frames import UNKNOWN, Frames, clip_labels, frames_of, level_names, seen_entries_of


@dataclass(frozen=True)
class PoseData:
    """Clips as the program sees them.

    encoding
        How poses become features.
    frames
        The arrays for the program.
    levels
        For each factor the names of the known levels; unknown ones follow them.
    clips
        Names of the clips.
    motion
        The clips themselves: what predictions are put on.
    alone
        Of new clips: the frames of each by itself.
    """

    encoding: PoseEncoding
    frames: Frames
    levels: dict[str, list[str]]
    clips: tuple[str, ...]
    motion: xr.Dataset
    alone: tuple[Frames, ...] = ()

    @property
    def data(self) -> tuple[Frames]:
        """The argument of the model's program."""
        return (self.frames,)

    def observed(self) -> xr.Dataset:
        """Return scaled features ``y`` (frame, feature), NaN where missing."""
        y = np.where(seen_entries_of(self.frames), self.frames.y, np.nan)
        clip = ("frame", np.asarray(self.clips)[np.asarray(self.frames.clip)])
        return xr.Dataset({"y": (("frame", "feature"), y)}, {**self._feature(), "clip": clip})

    def constants(self) -> xr.Dataset:
        """Return what brings features back to their units, and the clip of each frame."""
        constant = {
            "mean": ("feature", self.encoding.mean),
            "sd": ("feature", self.encoding.sd),
            "clip": ("frame", np.asarray(self.frames.clip)),
        }
        return xr.Dataset(constant, self._feature())

    def units(self) -> dict[str, Units]:
        """Return the units of the features: radians, radians a frame, and leg lengths a frame."""
        return {"y": Units(self.encoding.mean, self.encoding.sd)}

    def in_units_of(self, skeleton: Skeleton) -> Float[np.ndarray, " d"]:
        """Return what brings features in `units` to a skeleton's unit of length."""
        return self.encoding.in_units_of(skeleton)

    @property
    def angles(self) -> np.ndarray:
        """Columns of the features that are joint angles, in radians."""
        return np.arange(self.encoding.n_angles)

    def to_motion(self, values: Mapping[str, Float[np.ndarray, "..."]]) -> xr.Dataset:
        """Return the clips with these scaled features ``y`` (frame, feature).

        A clip's root goes through where it stood in the first frame that has it.
        """
        clip, made = np.asarray(self.frames.clip), []
        for number, (name, part) in enumerate(split(self.motion).items()):
            labels = {factor: str(part[factor].values[0]) for factor in self.levels
                      if factor in part.coords}  # fmt: skip
            path = part["root_position"].values
            there = np.flatnonzero(np.isfinite(path).all(axis=1))
            first = int(there[0]) if len(there) else 0
            one = self.encoding.motion(
                np.asarray(values["y"])[clip == number],
                skeleton_of(part),
                clip=name,
                start=path[0] if len(there) and not first else np.zeros(3),
                heading=self.encoding.heading(_recorded(part)),
                labels=labels,
                source=f"features of {name}",
                allow_missing=True,
            )
            if first:
                away = path[first] - one["root_position"].values[first]
                one = one.assign(root_position=one["root_position"] + away)
            made.append(one)
        return made[0] if len(made) == 1 else concat(made)

    def _feature(self) -> dict[str, list[str]]:
        return {"feature": list(self.encoding.layout.labels)}


def prepare(
    motion: xr.Dataset,
    factors: tuple[str, ...],
    *,
    align_heading: bool = False,
    lengths: Lengths = "body",
) -> PoseData:
    """Make training clips into arrays.

    Parameters
    ----------
    motion
        Clips with a text label for each factor ("" where unknown).
    factors
        Names of the style factors.
    align_heading
        Whether each clip's heading is taken out.
    lengths
        What travel is told in: ``body``, leg lengths, or ``file``, the unit of the files.

    Raises
    ------
    InputError
        If a label is missing, a factor is known for no clip, or skeletons disagree.
    """
    encoding = learn_encoding(motion, align_heading=align_heading, lengths=lengths)
    labels = {factor: clip_labels(motion, factor) for factor in factors}
    levels = {factor: level_names(motion, factor) for factor in factors}
    parts = {
        clip: encoding.entries(encoding.features(part, encoding.heading(part)))
        for clip, part in split(motion).items()
    }
    frames = frames_of(parts, labels, levels, frame_rate=encoding.frame_rate)
    return PoseData(encoding, frames, levels, tuple(parts), motion)


def prepare_new(motion: xr.Dataset, trained: PoseData) -> PoseData:
    """Make new clips into arrays, in the units and levels of the training clips.

    A clip's phase is that of the middle of what is seen of it: frames that are missing at its
    end are to come. A label that no training clip has is a new level, and one that is unknown
    (or no label at all) a level of its own.

    Parameters
    ----------
    motion
        Clips; NaN where missing.
    trained
        The training clips.

    Raises
    ------
    InputError
        If skeletons or frame rates are others.
    """
    encoding, clips = trained.encoding, split(motion)
    labels = {
        factor: clip_labels(motion, factor) if factor in motion.coords
        else dict.fromkeys(clips, UNKNOWN)
        for factor in trained.levels
    }  # fmt: skip
    # Levels that were unknown in training clips keep their places among the trained ones.
    known = {
        factor: [*names, *(f"\0{i}" for i in range(count - len(names)))]
        for (factor, names), count in zip(
            trained.levels.items(), trained.frames.levels, strict=True
        )
    }
    parts = {
        clip: encoding.entries(encoding.features(part, encoding.heading(_recorded(part))))
        for clip, part in clips.items()
    }
    lengths = {clip: _seen_until(part) for clip, part in parts.items()}

    def made(some: dict[str, np.ndarray]) -> Frames:
        own = {clip: lengths[clip] for clip in some}
        return frames_of(some, labels, known, trained.frames.missing, own,
                         frame_rate=encoding.frame_rate)  # fmt: skip

    alone = tuple(made({clip: part}) for clip, part in parts.items())
    return PoseData(encoding, made(parts), trained.levels, tuple(parts), motion, alone)


def _seen_until(y: Float[np.ndarray, "n d"]) -> int:
    """Return the number of frames up to the last of which anything is seen."""
    seen = np.flatnonzero(np.isfinite(y).any(axis=1))
    return int(seen[-1]) + 1 if len(seen) else len(y)


def _recorded(part: xr.Dataset) -> xr.Dataset:
    """Return a clip up to its last frame with a root: what its heading is told by."""
    there = np.flatnonzero(np.isfinite(part["root_position"].values).all(axis=1))
    return part.isel(frame=slice(int(there[-1]) + 1)) if len(there) else part
