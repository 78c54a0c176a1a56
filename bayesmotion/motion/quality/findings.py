"""What was found in recordings: telling it, and leaving frames out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from ...errors import InputError
from ..dataset import add_history
from ..joining import concat, split


@dataclass(frozen=True)
class Finding:
    """Something in a clip that is not movement.

    Parameters
    ----------
    clip
        Name of the clip.
    kind
        ``skeleton``, ``rest pose``, ``jump``, ``flip``, ``frozen``, ``floor`` or ``missing``.
    frames
        First and last frame concerned, counted from 0 in the clip.
    sentence
        What was found.
    drop
        Frames to leave out, if that mends it: always at the start or end of the clip.
    """

    clip: str
    kind: str
    frames: tuple[int, int]
    sentence: str
    drop: tuple[int, ...] = ()


def describe(findings: Sequence[Finding]) -> str:
    """Tell findings as text, one line each."""
    if not findings:
        return "Nothing found.\n"
    lines = []
    for finding in findings:
        count = f"{len(finding.drop)} frame{'s' * (len(finding.drop) > 1)}"
        mend = f" Leaving out {count} mends it." if finding.drop else ""
        lines.append(f"{finding.clip}: {finding.kind}: {finding.sentence}{mend}\n")
    return "".join(lines)


def drop(motion: xr.Dataset, findings: Sequence[Finding]) -> xr.Dataset:
    """Leave out the frames that findings say should be dropped.

    Parameters
    ----------
    motion
        The Motion that was checked.
    findings
        All or some of what `check` gave.

    Raises
    ------
    InputError
        If a clip is not there, its inside would be torn open, or fewer than two frames
        would be left.
    """
    parts = split(motion)
    for clip in dict.fromkeys(finding.clip for finding in findings):
        frames = {frame for f in findings if f.clip == clip for frame in f.drop}
        if clip not in parts:
            raise InputError(f"clip {clip!r}", "there is no such clip", "Check this Motion anew")
        if frames:
            parts[clip] = _without(parts[clip], clip, frames)
    joined = concat(list(parts.values()))
    # The order of columns is that of the motion, not that of the first clips.
    return joined.reindex({dim: motion[dim] for dim in ("dof", "joint") if dim in motion.dims})


def _without(part: xr.Dataset, clip: str, frames: set[int]) -> xr.Dataset:
    """Cut frames off the ends of one clip."""
    kept = [frame for frame in range(part.sizes["frame"]) if frame not in frames]
    if len(kept) < 2 or kept[-1] - kept[0] + 1 != len(kept):
        raise InputError(
            f"clip {clip!r}",
            f"without {len(frames)} of its frames it is not one piece of at least two frames",
            "Leave the clip out",
        )
    part = part.isel(frame=kept)
    part = part.assign_coords(
        frame=np.arange(len(kept)), time=("frame", part["time"].values - part["time"].values[0])
    )
    return add_history(part, f"drop: {len(frames)} frames at the ends of clip {clip}")
