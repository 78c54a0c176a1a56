"""Marker positions in TRC files (Motion Analysis, OpenSim)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from ...errors import InputError
from ...files import replacing
from ..dataset import clips, make_markers
from .rates import declared_rate, nominal
from .text import Line, number, read_lines, row_of, unique
from .units import metres_of

_UNITS = {1e-3: "mm", 1e-2: "cm", 1.0: "m"}


def read_trc(
    path: str | Path,
    *,
    frame_rate: float | None = None,
    clip: str | None = None,
    labels: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Read the marker positions of a TRC file.

    Parameters
    ----------
    path
        The file.
    frame_rate
        Frames a second, where the file's DataRate is rounded or wrong.
    clip
        Name of the clip, by default the file's stem.
    labels
        What is known of the clip, for example its subject.

    Returns
    -------
    Motion with `position` (frame, joint, space) in the file's unit, NaN where a cell is empty.
    Attribute ``metres`` is the metres in that unit, if it is a known one.

    Warns
    -----
    MotionWarning
        Of markers of the same name, which are numbered.

    Raises
    ------
    InputError
        If the file is missing or broken; file and line are named.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> motion = bm.read("walk.trc")  # doctest: +SKIP
    """
    path = Path(path)
    lines = [line for line in read_lines(path) if line.text]
    if len(lines) < 6 or not lines[0].text.lower().startswith("pathfiletype"):
        raise InputError(path, "it is no TRC file of six lines and more", "Give another")
    keys, values = [word.lower() for word in lines[1].words], lines[2].words
    head = dict(zip(keys, values, strict=False))
    if frame_rate is None:
        rate = number(lines[2], head.get("datarate", ""))
        where = f"{path}:{lines[2].number}"
        frame_rate = nominal(declared_rate(where, rate, f"DataRate {rate:g}"))
    names = [name for name in row_of(lines[3])[2:] if name]
    if not names:
        raise lines[3].error("no markers are named", "Name them: Frame#, Time, then one by one")
    rows = [_row(line, len(names)) for line in lines[5:]]
    declared = int(number(lines[2], head.get("numframes", "0")))
    if declared > len(rows):
        raise lines[2].error(
            f"{declared} frames are declared and {len(rows)} are there",
            "Get the file again if it breaks off, else correct the number",
        )
    return make_markers(
        unique(lines[3], names),
        np.array(rows).reshape(len(rows), len(names), 3),
        frame_rate=frame_rate,
        clip=path.stem if clip is None else clip,
        metres=metres_of(head.get("units", "")),
        labels=labels,
        source=path.name,
    )


def _row(line: Line, count: int) -> list[float]:
    """Read one frame: its number, its time, and three numbers a marker."""
    cells = row_of(line)
    values = cells[2:]
    # Markers at the end that were not seen may be left out whole.
    if len(cells) < 2 or len(values) % 3 or len(values) > 3 * count:
        raise line.error(
            f"{len(cells)} columns for {count} markers", f"Give {2 + 3 * count} columns"
        )
    seen = [number(line, cell) if cell and cell.lower() != "nan" else np.nan for cell in values]
    return seen + [np.nan] * (3 * count - len(values))


def write_trc(motion: xr.Dataset, path: str | Path) -> None:
    """Write the markers of one clip as TRC.

    Parameters
    ----------
    motion
        One clip of marker positions; NaN becomes an empty cell.
    path
        File to write; it is the old one or the new one.

    Raises
    ------
    InputError
        If there are several clips or joint angles, or the length unit is not mm, cm or m.
    """
    names = clips(motion)
    if len(names) != 1 or "position" not in motion:
        raise InputError(
            f"clips {', '.join(names)}",
            "a TRC file holds the markers of one clip",
            "Choose one with split(motion)[clip]; joint angles can be written as .bvh or .mot",
        )
    unit = _UNITS.get(motion.attrs.get("metres", 0.0))
    if unit is None:
        raise InputError(
            f"clip {names[0]!r}",
            "the unit of length is not known as mm, cm or m",
            "Say it with motion.assign_attrs(metres=0.001)",
        )
    markers = motion["joint"].values.tolist()
    odd = [name for name in markers if not name.isprintable() or name != name.strip() or not name]
    if odd:
        raise InputError(f"marker {odd[0]!r}", "TRC cannot hold this name", "Rename it")
    frames, rate = motion.sizes["frame"], motion.attrs["frame_rate"]
    count = len(markers)
    axes = [f"{axis}{index + 1}" for index in range(count) for axis in "XYZ"]
    head = [
        ["PathFileType", "4", "(X/Y/Z)", Path(path).name],
        [
            *("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"),
            *("OrigDataRate", "OrigDataStartFrame", "OrigNumFrames"),
        ],
        [f"{rate:.12g}", f"{rate:.12g}", frames, count, unit, f"{rate:.12g}", 1, frames],
        ["Frame#", "Time", *(cell for name in markers for cell in (name, "", ""))],
        ["", "", *axes],
        [],
    ]
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        for cells in head:
            file.write("\t".join(map(str, cells)) + "\n")
        values = motion["position"].values.reshape(frames, -1)
        for index, row in enumerate(values.tolist()):
            cells = ["" if np.isnan(value) else repr(value) for value in row]
            file.write("\t".join([str(index + 1), repr(index / rate), *cells]) + "\n")
