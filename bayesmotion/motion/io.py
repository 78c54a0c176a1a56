"""Reading motion files of any known kind, saving and loading Motions."""

from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import Any

import xarray as xr

from ..errors import InputError
from ..files import replacing
from .amc import read_amc
from .bvh import read_bvh
from .c3d import read_c3d
from .joining import concat
from .labels import Labels, read_labels, with_labels


def read(path: str | Path, **options: Any) -> xr.Dataset:
    """Read a motion file, going by its suffix: .amc, .bvh, .c3d or .nc (a saved Motion).

    Parameters
    ----------
    path
        The file.
    **options
        Passed on to `read_amc`, `read_bvh`, `read_c3d` or `load`.

    Raises
    ------
    InputError
        If the suffix is not known, the reader has no such option, or the file cannot
        be used.
    """
    path = Path(path)
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


def read_all(
    paths: Sequence[str | Path],
    *,
    labels: Labels | Mapping[str, Mapping[str, str]] | str | Path | None = None,
    **options: Any,
) -> xr.Dataset:
    """Read several files and join them to one Motion.

    Parameters
    ----------
    paths
        The files, of any known kind.
    labels
        Labels of the clips: a csv file, what `read_labels` gave, or a mapping.
    **options
        Passed on to the reader of every file.

    Raises
    ------
    InputError
        If a file cannot be used or the clips cannot be joined.
    """
    motion = concat([read(path, **options) for path in paths])
    if labels is None:
        return motion
    table = read_labels(labels) if isinstance(labels, str | Path) else labels
    return with_labels(motion, table)


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
