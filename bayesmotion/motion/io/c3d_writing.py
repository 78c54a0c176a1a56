"""Writing marker positions as C3D files: floating point numbers, little endian."""

import struct
from pathlib import Path

import numpy as np
import xarray as xr

from ...errors import InputError
from ...files import replacing
from ..dataset import clips

_UNITS = {0.001: "mm", 0.01: "cm", 1.0: "m"}
BLOCK = 512
_INTEL, _MAGIC = 84, 0x50
# A count of labels is one byte, and a count of frames in the header two.
_LABELS, _FRAMES = 255, 65535
_LONGEST = 127  # bytes of a name


def write_c3d(motion: xr.Dataset, path: str | Path) -> None:
    """Write the markers of one clip as C3D.

    Parameters
    ----------
    motion
        One clip of marker positions; one that was not seen (NaN) has a residual of -1.
    path
        File to write; it is the old one or the new one.

    Raises
    ------
    InputError
        If there are several clips or joint angles, the length unit is not mm, cm or m, or a name
        is longer than 127 bytes.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> bm.write(markers, "filled.c3d")  # doctest: +SKIP
    """
    names = clips(motion)
    if len(names) != 1 or "position" not in motion:
        raise InputError(
            f"clips {', '.join(names)}", "a C3D file holds the markers of one clip",
            "Choose one with split(motion)[clip]; joint angles can be written as .bvh or .mot",
        )  # fmt: skip
    unit = _UNITS.get(motion.attrs.get("metres", 0.0))
    if unit is None:
        raise InputError(
            f"clip {names[0]!r}", "the unit of length is not known as mm, cm or m",
            "Say it with motion.assign_attrs(metres=0.001)",
        )  # fmt: skip
    markers = [str(name).encode() for name in motion["joint"].values]
    for name in markers:
        if not name.strip() or len(name) > _LONGEST:
            raise InputError(f"marker {name.decode()!r}", "C3D cannot hold this name", "Rename it")
    position, rate = motion["position"].values, float(motion.attrs["frame_rate"])
    frames, count = position.shape[:2]
    missing = ~np.isfinite(position).all(axis=-1)
    values = np.zeros((frames, count, 4), dtype="<f4")
    values[..., :3] = np.where(missing[..., None], 0.0, position)
    values[..., 3] = np.where(missing, -1.0, 0.0)
    section = _parameters(markers, frames, rate, unit)
    start = 2 + len(section) // BLOCK
    head = struct.pack(
        "<BB5HfHHf", 2, _MAGIC, count, 0, 1, min(frames, _FRAMES), 0, -1.0, start, 0, rate
    )
    data = values.tobytes()
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(head.ljust(BLOCK, b"\0") + section + data + bytes(-len(data) % BLOCK))


def _parameters(markers: list[bytes], frames: int, rate: float, unit: str) -> bytes:
    """Return the section of parameters, in whole blocks; it says in which block data begin."""
    groups: dict[str, dict[str, bytes]] = {
        "POINT": {
            "USED": _whole(len(markers)),
            "FRAMES": _whole(min(frames, _FRAMES)),
            "DATA_START": _whole(0),
            "SCALE": _real(-1.0),
            "RATE": _real(rate),
            "UNITS": _texts([unit.encode()]),
        },
        "ANALOG": {"USED": _whole(0), "RATE": _real(rate)},
        # Two halves of a number, as the header has no room for long recordings.
        "TRIAL": {
            "ACTUAL_START_FIELD": _wholes(1, 0),
            "ACTUAL_END_FIELD": _wholes(frames % 65536, frames // 65536),
        },
    }
    for first in range(0, max(len(markers), 1), _LABELS):
        number = first // _LABELS
        name = "LABELS" if number == 0 else f"LABELS{number + 1}"
        groups["POINT"][name] = _texts(markers[first : first + _LABELS])
    blocks = -(-len(_section(groups, 0)) // BLOCK)
    groups["POINT"]["DATA_START"] = _whole(2 + blocks)
    return _section(groups, blocks).ljust(blocks * BLOCK, b"\0")


def _section(groups: dict[str, dict[str, bytes]], blocks: int) -> bytes:
    records = b""
    for number, (group, parameters) in enumerate(groups.items(), start=1):
        records += _record(group, -number, b"\0")
        for name, value in parameters.items():
            records += _record(name, number, value + b"\0")
    return bytes([1, _MAGIC, blocks % 256, _INTEL]) + records + bytes(2)


def _record(name: str, group: int, body: bytes) -> bytes:
    """Return a group or a parameter; the offset leads to the next one."""
    return (
        struct.pack("<bb", len(name), group)
        + name.encode()
        + struct.pack("<H", 2 + len(body))
        + body
    )


def _whole(value: int) -> bytes:
    return struct.pack("<bBH", 2, 0, value)


def _wholes(*values: int) -> bytes:
    return struct.pack(f"<bBB{len(values)}H", 2, 1, len(values), *values)


def _real(value: float) -> bytes:
    return struct.pack("<bBf", 4, 0, value)


def _texts(words: list[bytes]) -> bytes:
    width = max(len(word) for word in words)
    return struct.pack("<bBBB", -1, 2, width, len(words)) + b"".join(w.ljust(width) for w in words)
