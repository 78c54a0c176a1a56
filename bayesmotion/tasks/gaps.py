"""Gaps of markers filled in, with intervals: no fit is needed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from ..errors import InputError
from ..gp.marker_gaps import FilledGap, fill_marker_gaps
from ..motion.dataset import add_history
from ..motion.features import check_one_clip
from ..prediction import Mixture
from .cautions import warn
from .outcome import LENGTHS, QUANTILES, one_clip, table_from, times_of


@dataclass(frozen=True, repr=False)
class FilledGaps:
    """A recording of markers whose gaps are filled in.

    motion
        The recording with the mean in its gaps; all else is as it was recorded.
    given
        The recording.
    gaps
        Every gap of every marker, in the recording's unit; see `gp.marker_gaps`.
    messages
        What is not to be believed of it, in sentences.
    """

    motion: xr.Dataset
    given: xr.Dataset
    gaps: tuple[FilledGap, ...]
    messages: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return what was filled in, and what is not to be believed of it."""
        markers = {gap.marker for gap in self.gaps}
        told = (
            f"FilledGaps of {one_clip(self.motion)!r}: {len(self.gaps)} gaps of {len(markers)} "
            f"markers, {int(self.filled.sum())} positions"
        )
        return "\n".join([told, *(f"  warning: {text}" for text in self.messages)])

    @property
    def filled(self) -> Bool[np.ndarray, "n m"]:
        """Which positions were filled in, by frame and marker."""
        filled = np.zeros(self.motion["position"].shape[:2], dtype=bool)
        for gap in self.gaps:
            filled[gap.frames, gap.marker] = True
        return filled

    @property
    def sd(self) -> Float[np.ndarray, "n m"]:
        """Standard deviation of each coordinate, in the recording's unit; 0 where it was seen."""
        sd = np.zeros(self.motion["position"].shape[:2])
        for gap in self.gaps:
            sd[gap.frames, gap.marker] = np.sqrt(np.mean(gap.sds**2, axis=0))
        return sd

    def interval(
        self, probability: float = 0.9
    ) -> tuple[Float[np.ndarray, "n m 3"], Float[np.ndarray, "n m 3"]]:
        """Return the ends of the central intervals, in the recording's unit."""
        tail = 0.5 * (1.0 - probability)
        low, high = self._quantiles([tail, 1.0 - tail])
        return low, high

    def _quantiles(self, probabilities: Sequence[float]) -> Float[np.ndarray, "q n m 3"]:
        position = self.motion["position"].values
        out = np.repeat(position[None], len(probabilities), axis=0)
        for gap in self.gaps:
            count = len(gap.sds)
            mean = np.repeat(gap.mean[None], count, axis=0)
            sd = np.repeat(gap.sds[:, :, None], 3, axis=2)
            mixture = Mixture(mean, sd, np.full(count, 1.0 / count))
            for row, probability in zip(out, probabilities, strict=True):
                row[gap.frames, gap.marker] = mixture.quantile(probability)
        return out

    def to_dataset(self) -> xr.Dataset:
        """Return every frame with its uncertainty; what was seen has none.

        Returns
        -------
        ``mean``, ``sd`` and ``given`` (frame, channel) and ``quantiles`` (quantile, frame,
        channel) of every coordinate of every marker (``LKNE/x``) in the recording's unit;
        `bm.write` writes them as .nc or .csv.
        """
        motion, shape = self.motion, self.motion["position"].shape
        columns = shape[1] * shape[2]
        metres = motion.attrs.get("metres")
        unit = "length unit" if metres is None else LENGTHS.get(metres, f"{metres:.4g} m")
        names = [f"{joint}/{axis}" for joint in motion["joint"].values for axis in "xyz"]
        table = table_from(
            motion["position"].values.reshape(-1, columns), np.repeat(self.sd, 3, axis=1),
            self._quantiles(QUANTILES).reshape(len(QUANTILES), -1, columns), names,
            [unit] * columns, one_clip(motion), times_of(motion), {},
        )  # fmt: skip
        return table.assign(given=(table["sd"].dims, np.repeat(~self.filled, 3, axis=1)))


def fill_gaps(recording: xr.Dataset) -> FilledGaps:
    """Return a recording of markers whose gaps are filled in from the markers that are seen.

    The position of a marker within the body, as the markers tell that are seen throughout the gap,
    follows from theirs, and from where it was before and after; see `gp.marker_gaps`. All is
    learned from the recording itself. Gaps of joint angles are filled in by
    ``bm.denoise(recording, noise_degrees=0)``.

    Parameters
    ----------
    recording
        Motion of one clip of markers, NaN where one was not seen, in any unit.

    Returns
    -------
    The whole recording (``motion``, in its unit), its uncertainty (``sd``, ``interval``,
    ``to_dataset``), and the gaps.

    Raises
    ------
    InputError
        If there are several clips, or joint angles instead of markers.

    Warns
    -----
    MotionWarning
        Of markers that were never seen, which stay missing, and of gaps longer than all that is
        known of a marker.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> filled = bm.fill_gaps(bm.read("walk.c3d"))  # doctest: +SKIP
    >>> bm.write(filled.motion, "walk_filled.c3d")  # doctest: +SKIP
    """
    name = check_one_clip(recording)
    if "position" not in recording:
        raise InputError(
            f"clip {name!r}", "it has joint angles and no markers",
            "Fill in its gaps with denoise(recording, noise_degrees=0)",
        )  # fmt: skip
    position = recording["position"].values.copy()
    known = np.isfinite(position).all(axis=-1).any(axis=0)
    found = fill_marker_gaps(position[:, known], float(recording.attrs["frame_rate"]))
    columns = np.flatnonzero(known)
    gaps = tuple(
        FilledGap(int(columns[gap.marker]), gap.frames, gap.mean, gap.sds) for gap in found
    )
    for gap in gaps:
        position[gap.frames, gap.marker] = gap.mean
    messages = _messages(recording, known, gaps)
    warn("the filled recording", messages)
    motion = recording.assign(position=(recording["position"].dims, position))
    line = f"fill_gaps: {len(gaps)} gaps, {sum(len(gap.frames) for gap in gaps)} positions"
    return FilledGaps(add_history(motion, line), recording, gaps, messages)


def _messages(
    recording: xr.Dataset, known: Bool[np.ndarray, " m"], gaps: Sequence[FilledGap]
) -> tuple[str, ...]:
    names = recording["joint"].values
    told = []
    if not known.all():
        lost = ", ".join(str(name) for name in names[~known])
        told.append(f"{lost} is nowhere seen, and stays missing")
    unsure = [gap for gap in gaps if not gap.tried]
    if unsure:
        which = ", ".join(dict.fromkeys(str(names[gap.marker]) for gap in unsure))
        told.append(
            f"gaps of {which} are longer than all that is seen of it at a stretch: how far off "
            "they are is not known"
        )
    return tuple(told)
