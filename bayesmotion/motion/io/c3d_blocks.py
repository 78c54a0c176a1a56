"""The blocks of a C3D file: head, parameters and points, none read beyond its bounds.

A C3D file is a row of blocks of 512 bytes: the head, the parameters (records chained by
offsets, in named groups), and the data, in which every frame holds x, y, z and a fourth word
for each point, and behind them the analog samples of that frame. Numbers are in the
order and float format of the processor that wrote.
"""

import struct
from dataclasses import dataclass
from itertools import product
from math import isfinite, prod
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...errors import InputError

BLOCK = 512
_DEC, _SGI = 85, 86
# By the type of a parameter: bytes, and the letter by which struct calls it.
_TYPES = {-1: (1, "s"), 1: (1, "b"), 2: (2, "h"), 4: (4, "f")}
_UNKNOWN = 0xFFFF  # what stands for a frame number that a word cannot hold

Parameters = dict[tuple[str, str], "list[float] | list[str]"]


@dataclass(frozen=True)
class Head:
    """The first block, as far as it matters here."""

    points: int
    analog: int  # samples of all channels in a frame
    first: int
    last: int
    scale: float
    data: int  # byte at which the data begin
    rate: float


@dataclass(frozen=True)
class Blocks:
    """What a file says."""

    head: Head
    parameters: Parameters
    values: Float[np.ndarray, "frame point 4"]


def read_blocks(path: Path) -> Blocks:
    """Read a C3D file.

    Raises
    ------
    InputError
        If it is missing, no C3D file, damaged, or breaks off.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        what = "there is no such file" if isinstance(error, FileNotFoundError) else "unreadable"
        raise InputError(path, what, "Check the path") from error
    if len(content) < 2 or content[1] != 0x50:
        raise InputError(path, "it is not a C3D file (its second byte is not 0x50)", "Give another")
    start = (max(content[0], 2) - 1) * BLOCK
    if len(content) < start + 4:
        raise _broken_off(path, "it ends before the parameters")
    processor = content[start + 3]
    order = ">" if processor == _SGI else "<"
    head = _head(content, order, processor)
    if not start < head.data < len(content):
        raise _broken_off(path, "it ends before the data")
    parameters = _parameters(path, content[start : head.data], order, processor)
    if not any(group == "POINT" for group, _ in parameters):
        raise InputError(
            path, "the parameter section is empty or has no group POINT", "Export it anew"
        )
    return Blocks(head, parameters, _values(path, content, head, parameters, order, processor))


def first_number(parameters: Parameters, group: str, name: str) -> float | None:
    """Return the first number of a parameter, None where there is none that is finite."""
    values = numbers_of(parameters, group, name)
    return values[0] if values and isfinite(values[0]) else None


def numbers_of(parameters: Parameters, group: str, name: str) -> list[float]:
    """Return the numbers of a parameter, none where it is missing or holds text."""
    return [value for value in parameters.get((group, name), []) if not isinstance(value, str)]


def _broken_off(path: Path, where: str) -> InputError:
    return InputError(path, f"the file breaks off: {where}", "Get it again")


def _head(content: bytes, order: str, processor: int) -> Head:
    """Read the head; its data block tells whether its byte order is that of the parameters."""
    for one in (order, "<" if order == ">" else ">"):
        points, analog, first, last = struct.unpack_from(f"{one}4H", content, 2)
        scale = _floats(content[12:16], one, processor)[0]
        rate = _floats(content[20:24], one, processor)[0]
        data = (struct.unpack_from(f"{one}H", content, 16)[0] - 1) * BLOCK
        if BLOCK <= data < len(content):
            break
    return Head(points, analog, first, last, float(scale), data, float(rate))


def _floats(content: bytes, order: str, processor: int) -> Float[np.ndarray, " n"]:
    """Read 32-bit floats; those of DEC have their halves swapped and count a quarter."""
    if processor != _DEC:
        return np.frombuffer(content, f"{order}f4")
    halves = np.frombuffer(content, "<u2").reshape(-1, 2)
    bits = halves[:, 0].astype(np.uint32) << 16 | halves[:, 1]
    return bits.view(np.float32) / np.float32(4.0)


def _parameters(path: Path, section: bytes, order: str, processor: int) -> Parameters:
    """Read the parameters: records of a name, a group's number, and what they hold."""
    groups: dict[int, str] = {}
    found: dict[tuple[int, str], list[float] | list[str]] = {}
    at = 4
    while at + 2 <= len(section) and section[at]:
        length, number = struct.unpack_from("bb", section, at)
        after = at + 2 + abs(length)
        if after + 2 > len(section):
            raise _damaged(path, f"a record at byte {at} runs over its end")
        name = section[at + 2 : after].decode("latin-1").strip().upper()
        (step,) = struct.unpack_from(f"{order}H", section, after)
        end = after + step if step else len(section)
        if number < 0:
            groups[-number] = name
        elif (values := _record(section[after + 2 : end], order, processor)) is None:
            raise _damaged(path, f"{name} does not fit into its place")
        else:
            found[number, name] = values
        if not step:
            break
        at = end
    return {(groups.get(group, ""), name): values for (group, name), values in found.items()}


def _damaged(path: Path, what: str) -> InputError:
    return InputError(path, f"the parameter section is damaged: {what}", "Get the file again")


def _record(record: bytes, order: str, processor: int) -> list[float] | list[str] | None:
    """Read what a parameter holds; None if its place is too small."""
    if len(record) < 2 or len(record) < 2 + record[1]:
        return None
    (kind,) = struct.unpack_from("b", record)
    if kind not in _TYPES:
        return []
    size, letter = _TYPES[kind]
    dims = list(record[2 : 2 + record[1]])
    count = prod(dims)
    data = record[2 + len(dims) : 2 + len(dims) + count * size]
    if len(data) < count * size:
        return None
    if letter == "s":
        width = dims[0] if dims else 1
        texts = [data[i : i + width] for i in range(0, len(data), max(width, 1))]
        return [_text(text) for text in texts]
    if letter == "f":
        return [float(value) for value in _floats(data, order, processor)]
    return [float(value) for value in struct.unpack(f"{order}{count}{letter}", data)]


def _text(content: bytes) -> str:
    """Turn the bytes of a name or word into text."""
    try:
        return content.decode("utf-8").strip(" \0")
    except UnicodeDecodeError:
        return content.decode("latin-1").strip(" \0")


def _values(
    path: Path, content: bytes, head: Head, parameters: Parameters, order: str, processor: int
) -> Float[np.ndarray, "frame point 4"]:
    """Read the points of all frames, positions in the file's unit."""
    scale = first_number(parameters, "POINT", "SCALE") or head.scale
    if not scale or not isfinite(scale):
        raise InputError(path, f"POINT:SCALE is {scale:g}", "Export it anew")
    size = 4 if scale < 0 else 2
    there = len(content) - head.data
    points, analog, frames = _shape(path, head, parameters, there, size)
    stride = (4 * points + analog) * size
    data = content[head.data : head.data + frames * stride]
    numbers = np.frombuffer(data, f"{order}i2") if size == 2 else _floats(data, order, processor)
    with np.errstate(invalid="ignore"):  # some kinds of NaN warn when they are made longer
        values = numbers.reshape(frames, -1)[:, : 4 * points].astype(np.float64)
    values = values.reshape(frames, points, 4)
    if size == 2:
        values[..., :3] *= scale
    return values


def _shape(
    path: Path, head: Head, parameters: Parameters, there: int, size: int
) -> tuple[int, int, int]:
    """Return points, analog samples a frame, and frames.

    The head and the parameters both tell them, and not always the same; the first that fills
    the file up to its last block is believed, else what the head says.
    """
    counts = list(
        product(_points(head, parameters), _analog(head, parameters), _frames(head, parameters))
    )
    for points, analog, frames in counts:
        left = there - frames * (4 * points + analog) * size
        if points and 0 <= left < BLOCK:
            return points, analog, frames
    points, analog, frames = counts[0] if counts else (head.points, head.analog, 0)
    if not points:
        channels = int(first_number(parameters, "ANALOG", "USED") or 0)
        raise InputError(
            path,
            f"there are no markers, but {channels} analog channels",
            "Give a recording of markers",
        )
    stride = (4 * points + analog) * size
    whole = there // stride
    if not whole:
        raise _broken_off(path, f"{points} markers are promised, and no frame of them is there")
    if frames > whole:
        raise _broken_off(path, f"{whole} of {frames} frames are there")
    return points, analog, frames or whole


def _points(head: Head, parameters: Parameters) -> list[int]:
    """Return how many points there may be, the likeliest first."""
    used = first_number(parameters, "POINT", "USED")
    return [head.points] if used is None else [head.points, int(used) & _UNKNOWN]


def _analog(head: Head, parameters: Parameters) -> list[int]:
    """Return how many analog samples a frame may have, the likeliest first."""
    used = first_number(parameters, "ANALOG", "USED")
    rates = [first_number(parameters, group, "RATE") or 0.0 for group in ("ANALOG", "POINT")]
    if not used or min(rates) <= 0:
        return [head.analog]
    return [head.analog, (int(used) & _UNKNOWN) * max(round(rates[0] / rates[1]), 1)]


def _frames(head: Head, parameters: Parameters) -> list[int]:
    """Return how many frames there may be, the likeliest first."""
    told = [head.last - head.first + 1 if head.last != _UNKNOWN else 0]
    frames = first_number(parameters, "POINT", "FRAMES") or 0.0
    told.append(int(frames) if frames > 0 and frames != _UNKNOWN else 0)
    first, last = (_long(parameters, f"ACTUAL_{end}_FIELD") for end in ("START", "END"))
    if first and last:
        told.append(last - first + 1)
    told.append(int(first_number(parameters, "POINT", "LONG_FRAMES") or 0.0))
    return [count for count in told if count > 0]


def _long(parameters: Parameters, name: str) -> int:
    """Return a frame number that is stored as two words of 16 bits, 0 where it is missing."""
    words = numbers_of(parameters, "TRIAL", name)
    if len(words) != 2 or not all(map(isfinite, words)):
        return 0
    return (int(words[0]) & _UNKNOWN) + (int(words[1]) & _UNKNOWN) * 65536
