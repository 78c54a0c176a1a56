"""Training clips made into what a pose model is given, and into ArviZ's data groups."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from ..motion.joining import split
from .poses import Frames, PoseEncoding, clip_labels, frames_of, learn_encoding, level_names


@dataclass(frozen=True)
class Training:
    """Training clips as a pose model sees them.

    encoding
        How poses become features.
    frames
        The arrays for the program.
    levels
        For each factor the names of the known levels; unknown ones follow them.
    clips
        Names of the clips.
    """

    encoding: PoseEncoding
    frames: Frames
    levels: dict[str, list[str]]
    clips: tuple[str, ...]

    @property
    def data(self) -> tuple[Frames]:
        """The arguments of the model's program."""
        return (self.frames,)

    def observed(self) -> xr.Dataset:
        """What the model explains: scaled features ``y`` (frame, feature), NaN where not seen."""
        frames = self.frames
        seen = np.einsum("pn,pd->nd", frames.missing.rows, frames.missing.columns) > 0
        y = (("frame", "feature"), np.where(seen, frames.y, np.nan))
        clip = ("frame", np.asarray(self.clips)[np.asarray(frames.clip)])
        return xr.Dataset({"y": y}, {**self._feature(), "clip": clip})

    def constants(self) -> xr.Dataset:
        """What brings features back to their units, and the clip (by number) of each frame."""
        constant = {
            "mean": ("feature", self.encoding.mean),
            "spread": ("feature", self.encoding.spread),
            "clip": ("frame", np.asarray(self.frames.clip)),
        }
        return xr.Dataset(constant, self._feature())

    def _feature(self) -> dict[str, list[str]]:
        return {"feature": list(self.encoding.layout.labels)}


def prepare(motion: xr.Dataset, factors: tuple[str, ...], *, turned: bool = False) -> Training:
    """Make training clips into arrays.

    Parameters
    ----------
    motion
        Clips with a text label for each factor ("" where unknown).
    factors
        Names of the style factors.
    turned
        Whether each clip's heading is taken out.

    Raises
    ------
    InputError
        If a label is missing, a factor is known for no clip, or skeletons disagree.
    """
    encoding = learn_encoding(motion, turned=turned)
    labels = {factor: clip_labels(motion, factor) for factor in factors}
    levels = {factor: level_names(motion, factor) for factor in factors}
    parts = {
        clip: encoding.told(encoding.features(part, encoding.heading(part)))
        for clip, part in split(motion).items()
    }
    frames = frames_of(parts, labels, levels, frame_rate=encoding.frame_rate)
    return Training(encoding, frames, levels, tuple(parts))
