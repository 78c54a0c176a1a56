"""Reading marker positions from C3D files."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import ezc3d
import numpy as np
import xarray as xr

from ...errors import InputError
from ..dataset import make_markers

_METRES = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "in": 0.0254, "ft": 0.3048}


def read_c3d(
    path: str | Path, *, clip: str | None = None, labels: Mapping[str, str] | None = None
) -> xr.Dataset:
    """Read the marker positions of a C3D file.

    Parameters
    ----------
    path
        The file.
    clip
        Name of the clip, by default the file's stem.
    labels
        What is known of the clip, for example its subject.

    Returns
    -------
    Motion with `position` (frame, joint, space) in the file's unit, NaN where a marker
    was not seen. Attribute ``metres`` is the metres in that unit, if the file says.

    Raises
    ------
    InputError
        If the file is missing, not C3D, or has no markers, fewer than two frames, or
        two markers of the same name.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path")
    try:
        content = ezc3d.c3d(str(path))
    except (OSError, RuntimeError, ValueError, IndexError) as error:
        raise InputError(path, f"it is not a C3D file ({error})", "Give another file") from error
    point = content["parameters"]["POINT"]
    names = _names(path, point)
    # ezc3d gives NaN where the residual is negative: the marker was not seen.
    position = np.array(content["data"]["points"][:3].transpose(2, 1, 0), dtype=np.float64)
    _check_whole(path, len(position))
    if position.shape[1] == 0 or len(position) < 2 or len(names) != position.shape[1]:
        raise InputError(
            path,
            f"{len(position)} frames of {position.shape[1]} markers with {len(names)} names",
            "Give a file of at least two frames in which every marker has a name",
        )
    return make_markers(
        names,
        position,
        frame_rate=float(content["header"]["points"]["frame_rate"]),
        clip=path.stem if clip is None else clip,
        metres=_metres(point),
        labels=labels,
        source=path.name,
    )


def _check_whole(path: Path, frames: int) -> None:
    """Refuse a file that holds fewer frames than its head says (ezc3d reads what is there)."""
    head = path.read_bytes()[:512]
    # Words 4 and 5 are the first and last frame, in the byte order of the machine that
    # wrote; a last frame of 65535 stands for more than the word can hold.
    orders: tuple[Literal["little", "big"], ...] = ("little", "big")
    ends = [[int.from_bytes(head[at : at + 2], order) for at in (6, 8)] for order in orders]
    told = min((last - first + 1 for first, last in ends if last >= first), default=0)
    if told > frames and all(last != 65535 for _, last in ends):
        raise InputError(
            path, f"the file breaks off: {frames} of {told} frames are there", "Get it again"
        )


def _names(path: Path, point: Mapping) -> list[str]:
    """Give the names of the markers; long lists go on in LABELS2, LABELS3, ..."""
    names: list[str] = []
    for number in range(1, 100):
        key = "LABELS" if number == 1 else f"LABELS{number}"
        if key not in point:
            break
        names += [str(name).strip() for name in point[key]["value"]]
    names = names[: int(point["USED"]["value"][0])]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise InputError(
            path, f"several markers are called {', '.join(sorted(twice))}", "Rename them"
        )
    return names


def _metres(point: Mapping) -> float | None:
    """Give the metres in the unit of length, where the file says."""
    units = point["UNITS"]["value"] if "UNITS" in point else []
    return _METRES.get(str(units[0]).strip().lower()) if len(units) else None
