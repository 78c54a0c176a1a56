"""Reading recordings the way all commands do."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr

from .. import console
from ..errors import InputError
from ..motion.check import check
from ..motion.dataset import clips, label_names
from ..motion.findings import Finding, drop
from ..motion.io import read
from ..motion.joining import concat
from ..motion.labels import read_labels, with_labels
from ..motion.resampling import downsample


def joined(files: Sequence[Path], labels: Path | None) -> xr.Dataset:
    """Read files and give their clips the labels of a table; an empty cell means unknown."""
    motion = concat([read(path) for path in files])
    if labels is None:
        return motion
    table = read_labels(labels)
    listed = np.isin(motion["clip"].values, list(table.rows))
    columns = {name for row in table.rows.values() for name in row}
    for name in columns & set(label_names(motion)):
        known = np.where(listed, "", motion[name].values)
        motion = motion.assign_coords({name: ("frame", known)})
    return with_labels(motion, table)


def factor_of(motion: xr.Dataset, rate: float) -> int:
    """Tell of how many frames one is kept to come to a rate.

    Raises
    ------
    InputError
        If the rate does not divide the recordings' rate.
    """
    has = float(motion.attrs["frame_rate"])
    factor = round(has / rate) if rate > 0 else 0
    if factor < 1 or abs(has / factor - rate) > 1e-9 * rate:
        fitting = ", ".join(f"{has / n:g}" for n in (1, 2, 3, 4, 5, 6))
        raise InputError(
            f"--rate {rate:g}",
            f"the recordings have {has:g} frames a second, of which that is no whole part",
            f"Use one of {fitting}",
        )
    return factor


def at_rate(motion: xr.Dataset, rate: float, filter: str) -> xr.Dataset:
    """Bring recordings to a frame rate, and say what was done."""
    fewer = downsample(motion, factor_of(motion, rate), filter=_checked(filter))
    added = fewer.attrs["history"].splitlines()[len(motion.attrs["history"].splitlines()) :]
    for line in added:
        console.note(line)
    return fewer.assign_attrs(frame_rate=float(rate))


def _checked(filter: str) -> Literal["none", "lowpass"]:
    """Refuse a filter that is not known."""
    if filter != "none" and filter != "lowpass":
        raise InputError(f"--filter {filter}", "there is no such filter", "Use none or lowpass")
    return filter


def looked_over(motion: xr.Dataset, *, dropping: bool) -> xr.Dataset:
    """Warn of what is suspicious; with `dropping`, leave out the frames that mends it."""
    findings = check(motion)
    for finding in findings:
        console.note(f"warning: {told(finding)}")
    if dropping:
        return drop(motion, findings)
    if any(finding.drop for finding in findings):
        console.note("the suspicious frames are kept; --drop leaves them out")
    return motion


def told(finding: Finding) -> str:
    """Tell a finding in one line, with the frames to drop."""
    text = f"{finding.clip}: {finding.kind}: {finding.sentence}"
    if not finding.drop:
        return text
    first, last = min(finding.drop), max(finding.drop)
    frames = f"frame {first}" if first == last else f"frames {first} to {last}"
    return f"{text} Drop {frames} (counted from 0)."


def one_clip(path: Path) -> xr.Dataset:
    """Read a file that is to hold one clip.

    Raises
    ------
    InputError
        If it holds several.
    """
    motion = read(path)
    names = clips(motion)
    if len(names) > 1:
        raise InputError(path, f"it holds {len(names)} clips", "Give a file of one clip")
    return motion
