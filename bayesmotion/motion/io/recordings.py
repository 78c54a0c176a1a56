"""Recordings read for a model: joined, looked over, and brought to one frame rate."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ...errors import InputError, MotionWarning
from ..dataset import clips, label_names
from ..joining import split
from ..quality.check import check
from ..quality.findings import Finding
from ..quality.findings import drop as without_findings
from ..resampling import Filter, keeps_frames, resample
from .labels import read_labels, with_labels
from .names import with_distinct_names
from .reading import read


def read_clips(
    files: Sequence[Path],
    *,
    labels: Path | None = None,
    rate: float = 30.0,
    filter: Filter = "lowpass",
    drop: bool = False,
    frame_rate: float | None = None,
    skeleton: Path | None = None,
) -> xr.Dataset:
    """Read motion capture files as clips at one frame rate.

    Parameters
    ----------
    files
        Recordings: .amc, .bvh, .mot, .npz (AMASS) or a saved .nc.
    labels
        A csv table with one row a clip; an empty cell means unknown.
    rate
        Frames a second that the clips are brought to, from any.
    filter
        ``lowpass`` first removes what is faster than half the rate; ``none`` keeps every n-th
        frame as it is, where that makes the rate.
    drop
        Whether suspicious frames are left out.
    frame_rate
        Frames a second of the files, where they do not say or are wrong.
    skeleton
        The .asf file of .amc files.

    Warns
    -----
    MotionWarning
        Of what is suspicious, what was done to come to the rate, and labels left empty.

    Raises
    ------
    InputError
        If a file cannot be used or holds one pose.
    """
    motion = read(*files, **given(frame_rate=frame_rate, skeleton=skeleton))
    for name, part in split(motion).items():
        if part.sizes["frame"] < 2:
            raise InputError(
                f"clip {name!r}", "it has one frame: a pose, and no motion", "Leave it out"
            )
    if labels is not None:
        motion = labelled(motion, labels)
    return resampled(looked_over(motion, dropping=drop), rate, filter)


def given(**options: Any) -> dict[str, Any]:
    """Return the options of reading that were given: not None."""
    return {name: value for name, value in options.items() if value is not None}


def labelled(motion: xr.Dataset, path: Path) -> xr.Dataset:
    """Return clips with the labels of a table; its empty cells are unknown, whatever files say.

    Warns
    -----
    MotionWarning
        Of labels that are known of some clips and not of others.
    """
    table = read_labels(path)
    listed = np.isin(motion["clip"].values, list(table.rows))
    columns = {name for row in table.rows.values() for name in row}
    for name in columns & set(label_names(motion)):
        motion = motion.assign_coords({name: ("frame", np.where(listed, "", motion[name].values))})
    motion = with_labels(motion, table)
    for name in sorted(columns):
        unknown = dict.fromkeys(motion["clip"].values[motion[name].values == ""].tolist())
        if 0 < len(unknown) < len(clips(motion)):
            warnings.warn(
                f"the {name} of {', '.join(unknown)} is unknown", MotionWarning, stacklevel=3
            )
    return motion


def read_clip(
    path: Path,
    *,
    frame_rate: float | None = None,
    skeleton: Path | None = None,
    joints: Path | None = None,
) -> xr.Dataset:
    """Return the one clip of a file; options as of `read_clips`, and the table of its joints.

    Raises
    ------
    InputError
        If the file holds several, or cannot be used.
    """
    motion = read(path, **given(frame_rate=frame_rate, skeleton=skeleton, joints=joints))
    names = clips(motion)
    if len(names) > 1:
        raise InputError(path, f"it holds {len(names)} clips", "Give a file of one clip")
    return motion


def read_each(
    files: Sequence[Path], *, frame_rate: float | None = None, skeleton: Path | None = None
) -> dict[str, xr.Dataset]:
    """Return every clip of files by its name; they need not fit together.

    Clips of one name are told apart by folder, as `read` does; options as of `read_clips`.

    Raises
    ------
    InputError
        If a file cannot be used, or is named twice.
    """
    options = given(frame_rate=frame_rate, skeleton=skeleton)
    parts = with_distinct_names(files, [read(path, **options) for path in files])
    found: dict[str, xr.Dataset] = {}
    for path, part in zip(files, parts, strict=True):
        for name, clip in split(part).items():
            if name in found:
                raise InputError(path, f"two clips are called {name!r}", "Name each file once")
            found[name] = clip
    return found


def looked_over(motion: xr.Dataset, *, dropping: bool) -> xr.Dataset:
    """Warn of what is suspicious; with `dropping`, leave out the frames that mends it."""
    findings = check(motion)
    for finding in findings:
        warnings.warn(told(finding), MotionWarning, stacklevel=2)
    if dropping:
        return without_findings(motion, findings)
    if any(finding.drop for finding in findings):
        warnings.warn(
            "the suspicious frames are kept; drop them to leave them out", MotionWarning,
            stacklevel=2,
        )  # fmt: skip
    return motion


def told(finding: Finding) -> str:
    """Return a finding in one line, with the frames to drop."""
    text = f"{finding.clip}: {finding.kind}: {finding.sentence}"
    if not finding.drop:
        return text
    first, last = min(finding.drop), max(finding.drop)
    frames = f"frame {first}" if first == last else f"frames {first} to {last}"
    return f"{text} Drop {frames} (counted from 0)."


def resampled(motion: xr.Dataset, rate: float, filter: Filter = "lowpass") -> xr.Dataset:
    """Return recordings at a frame rate; what was done is in their history.

    Warns
    -----
    MotionWarning
        Where frames had to be made, because leaving some out does not make the rate.
    """
    has = float(motion.attrs["frame_rate"])
    made = resample(motion, rate, filter=filter)
    if not keeps_frames(has, rate):
        warnings.warn(
            f"recordings of {has:g} frames a second are resampled to {rate:g}", MotionWarning,
            stacklevel=2,
        )  # fmt: skip
    return made
