"""Reading motion files of any known kind, saving and loading Motions."""

from collections.abc import Callable, Mapping
from inspect import signature
from pathlib import Path
from typing import Any

import xarray as xr

from ...errors import InputError
from ...files import replacing
from ..dataset import skeleton_of
from ..joining import concat
from .acclaim import write_amc, write_asf
from .amc import read_amc
from .bvh import read_bvh, write_bvh
from .c3d import read_c3d
from .labels import Labels, read_labels, with_labels
from .names import with_distinct_names
from .tables import Tabular, write_table

# A BVH file tells the rate as a rounded frame time: 0.0083333 s are 120.0005 Hz.
ROUNDING = 1e-4


def read(
    *paths: str | Path,
    labels: Labels | Mapping[str, Mapping[str, str]] | str | Path | None = None,
    **options: Any,
) -> xr.Dataset:
    """Read motion files, going by their suffix, and join their clips to one Motion.

    Parameters
    ----------
    paths
        The files: .amc, .bvh, .c3d or .nc (a saved Motion).
    labels
        Labels of the clips: a csv file with one row a clip (``clip,subject,gait``; an empty
        cell is unknown; rows of other clips are left alone), what `read_labels` gave, or a
        mapping.
    **options
        Passed on to `read_amc`, `read_bvh`, `read_c3d` or `load` for every file.

    Returns
    -------
    The Motion; a frame rate that is a rounded whole number is that number. Clips of one name in
    several folders get their folder's in front, as in ``monday/walk_01``; so do skeletons.

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
    motion = reader(path, **options)
    rate = float(motion.attrs["frame_rate"])
    if rate != round(rate) and abs(rate - round(rate)) <= ROUNDING * rate:
        motion = motion.assign_attrs(frame_rate=float(round(rate)))
    return motion


def write(motion: xr.Dataset | Tabular, path: str | Path) -> None:
    """Write a Motion or what a task says, going by the suffix of the file.

    A Motion is written as .bvh, .amc (its .asf beside it) or .nc. What a task says, such as a
    forecast, is written with its uncertainty as .nc or as a long table of .csv: mean, sd and
    quantiles by time and channel (its `to_dataset`).

    Parameters
    ----------
    motion
        The Motion, of which .bvh and .amc hold one clip; or what a task returned.
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
    if suffix == ".bvh":
        write_bvh(motion, path)
    elif suffix == ".amc":
        write_asf(skeleton_of(motion), path.with_suffix(".asf"))
        write_amc(motion, path)
    elif suffix == ".nc":
        save(motion, path)
    else:
        raise InputError(path, f"nothing is written as {suffix!r}", "Use .bvh, .amc or .nc")


def save(motion: xr.Dataset, path: str | Path) -> None:
    """Write a Motion as netCDF; the file is the old one or the new one, never half of one."""
    with replacing(path) as temporary:
        motion.to_netcdf(temporary, engine="h5netcdf", format="NETCDF4")


def load(path: str | Path) -> xr.Dataset:
    """Read back what `save` wrote.

    Raises
    ------
    InputError
        If there is no such file, it is not netCDF or it does not hold a Motion.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path")
    try:
        motion = xr.load_dataset(path, engine="h5netcdf")
    except (OSError, ValueError) as error:
        raise InputError(
            path, f"it is not a netCDF file ({error})", "Give a saved Motion"
        ) from error
    missing = [name for name in ("frame_rate", "skeletons", "source") if name not in motion.attrs]
    missing += [name for name in ("clip", "skeleton", "time") if name not in motion.coords]
    if missing:
        raise InputError(path, f"{', '.join(missing)} missing", "Give a file written by save()")
    return _tidy(motion)


def _tidy(motion: xr.Dataset) -> xr.Dataset:
    """Forget how the file stored it: a text of five letters must not stay cut to five."""
    for variable in motion.variables.values():
        variable.encoding = {}
    motion.encoding = {}
    for name in ("frame_rate", "metres"):
        if name in motion.attrs:
            motion.attrs[name] = float(motion.attrs[name])
    return motion


READERS: dict[str, Callable[..., xr.Dataset]] = {
    ".amc": read_amc,
    ".bvh": read_bvh,
    ".c3d": read_c3d,
    ".nc": load,
}
