"""Reading motion files of any known kind, saving and loading Motions."""

from collections.abc import Callable, Mapping
from inspect import signature
from pathlib import Path
from typing import Any

import xarray as xr

from ...errors import InputError
from ...files import MOTION
from ...netcdf import read_netcdf, write_netcdf
from ..dataset import skeleton_of
from ..joining import concat, with_rate
from ..roles import with_joints
from ..validation import require_motion
from .acclaim import write_amc, write_asf
from .amass import read_amass
from .amc import read_amc
from .bvh import read_bvh, write_bvh
from .c3d import read_c3d
from .c3d_writing import write_c3d
from .labels import Labels, read_labels, with_labels
from .mot import read_mot, write_mot
from .names import with_distinct_names
from .tables import Tabular, write_table
from .trc import read_trc, write_trc


def read(
    *paths: str | Path,
    labels: Labels | Mapping[str, Mapping[str, str]] | str | Path | None = None,
    joints: Mapping[str, str] | str | Path | None = None,
    **options: Any,
) -> xr.Dataset:
    """Read motion files, going by their suffix, and join their clips to one Motion.

    Parameters
    ----------
    paths
        The files: .amc, .bvh, .mot (joint angles), .npz (AMASS), .c3d, .trc (markers), or .nc
        (a saved Motion).
    labels
        Labels of the clips: a csv file with one row a clip (``clip,subject,gait``; an empty
        cell is unknown; rows of other clips are left alone), what `read_labels` gave, or a
        mapping.
    joints
        Which joints are which, where their names do not tell: as of `with_joints`, such as
        ``{"left hip": "Bone_7"}`` or a csv table.
    **options
        Passed on to `read_amc`, `read_bvh`, `read_c3d` and so on for every file, such as
        ``frame_rate=30``, which all of them have.

    Returns
    -------
    The Motion; a frame rate that is a rounded whole number is that number. Clips of one name in
    several folders get their folder's in front, as in ``monday/walk_01``; so do skeletons.

    Warns
    -----
    MotionWarning
        Of what was mended on the way, such as names that stand twice, or frame rates that
        differ a little.

    Raises
    ------
    InputError
        If a suffix is not known, a reader has no such option, a file cannot be used, or the
        clips cannot be joined.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> motion = bm.read("02_02.amc", "35_01.bvh", labels="labels.csv")  # doctest: +SKIP
    """
    if not paths:
        raise InputError("read", "no file is named", "Name at least one")
    parts = [_read_one(Path(path), options) for path in paths]
    parts = with_distinct_names([Path(path) for path in paths], parts)
    motion = parts[0] if len(parts) == 1 else concat(parts)
    if joints is not None:
        motion = with_joints(motion, joints)
    if labels is None:
        return motion
    table = read_labels(labels) if isinstance(labels, str | Path) else labels
    return with_labels(motion, table)


def _read_one(path: Path, options: Mapping[str, Any]) -> xr.Dataset:
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            path,
            f"files ending in {path.suffix or 'nothing'!r} are not known",
            f"Use one of {', '.join(READERS)}",
        )
    known = list(signature(reader).parameters)[1:]
    for option in options:
        if option not in known:
            raise InputError(
                path,
                f"{path.suffix.lower()} files have no option {option!r}",
                f"Use {', '.join(known)}" if known else "Leave it out",
            )
    return reader(path, **options)


def write(motion: xr.Dataset | Tabular, path: str | Path) -> None:
    """Write a Motion or what a task says, going by the suffix of the file.

    A Motion is written as .bvh, .amc (its .asf beside it), .mot, .trc, .c3d or .nc. What a task
    says, such as a forecast, is written with its uncertainty as .nc or as a long table of .csv:
    mean, sd and quantiles by time and channel (its `to_dataset`).

    Parameters
    ----------
    motion
        The Motion; all but .nc hold one clip, .trc and .c3d one of markers. Or what a task
        returned.
    path
        The file; what was there stays until the new one is whole.

    Raises
    ------
    InputError
        If the suffix is not known, or the file cannot hold the Motion.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> bm.write(future, "forecast.csv")  # doctest: +SKIP
    >>> bm.write(future.motion, "forecast.bvh")  # doctest: +SKIP
    """
    path = Path(path)
    if not isinstance(motion, xr.Dataset):
        write_table(motion.to_dataset(), path)
        return
    suffix = path.suffix.lower()
    if suffix == ".amc":
        write_asf(skeleton_of(motion), path.with_suffix(".asf"))
        write_amc(motion, path)
        return
    if suffix not in WRITERS:
        known = ", ".join(WRITERS)
        raise InputError(path, f"nothing is written as {suffix!r}", f"Use .amc, {known}")
    WRITERS[suffix](motion, path)


def save(motion: xr.Dataset, path: str | Path) -> None:
    """Write a Motion as netCDF; the file is the old one or the new one, never half of one.

    Raises
    ------
    InputError
        If the name does not end in ``.nc``, or there is a file that holds no Motion.
    """
    MOTION.check(path)
    write_netcdf(path, motion)


def load(path: str | Path, *, frame_rate: float | None = None) -> xr.Dataset:
    """Read back what `save` wrote; with a frame rate given, as so many frames a second.

    Raises
    ------
    InputError
        If there is no such file, it is not netCDF or it does not hold a Motion.
    """
    motion = read_netcdf(path, "Give a saved Motion").to_dataset()
    require_motion(motion, path)
    numbers = {name: float(motion.attrs[name]) for name in ("frame_rate", "metres")
               if name in motion.attrs}  # fmt: skip
    motion = motion.assign_attrs(numbers)
    return motion if frame_rate is None else with_rate(motion, frame_rate)


READERS: dict[str, Callable[..., xr.Dataset]] = {
    ".amc": read_amc,
    ".bvh": read_bvh,
    ".mot": read_mot,
    ".npz": read_amass,
    ".c3d": read_c3d,
    ".trc": read_trc,
    ".nc": load,
}
WRITERS: dict[str, Callable[[xr.Dataset, Path], None]] = {
    ".bvh": write_bvh,
    ".mot": write_mot,
    ".trc": write_trc,
    ".c3d": write_c3d,
    ".nc": save,
}
