"""The text of a BVH file: nodes of the hierarchy, then one row of numbers a frame."""

import re
import warnings
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...errors import InputError, MotionWarning
from .rates import declared_rate, nominal
from .text import Line, number, numbered, numbers

_CHANNEL = re.compile(r"([xyz])(position|rotation)", re.IGNORECASE)
_HEAD = re.compile(r"(frames|frame\s*time)\s*(?::|(?<=\s))\s*(.*)", re.IGNORECASE)


@dataclass
class Node:
    """One node of the hierarchy; `parent` is its place in the list, -1 for the root."""

    line: Line
    name: str
    parent: int
    end: bool
    offset: tuple[float, ...] = ()
    channels: list[str] = field(default_factory=list)  # "xposition", "zrotation", ...


@dataclass
class Content:
    """What a file says."""

    nodes: list[Node]
    rate: float  # frames a second
    values: Float[np.ndarray, "frame channel"]


def read_content(path: Path, lines: list[Line], rate: float | None = None) -> Content:
    """Read the text of a BVH file; with a rate given, whatever it says of its frame time.

    Raises
    ------
    InputError
        If it is broken; the line is named.
    """
    lines = [line for line in lines if line.text and not line.text.startswith("#")]
    words = [line.text.upper() for line in lines]
    if not words or not words[0].startswith("HIERARCHY"):
        raise InputError(path, "it does not start with HIERARCHY", "Give a BVH file")
    if "MOTION" not in words:
        raise lines[-1].error("the file ends without a line MOTION", "Get it again")
    start = words.index("MOTION")
    nodes = _nodes(path, lines[:start])
    heads: dict[str, Line] = {}
    rows = deque(lines[start + 1 :])
    while rows and (found := _HEAD.fullmatch(rows[0].text)):
        heads[found[1][-1].lower()] = rows.popleft()
    if rate is None:
        rate = _rate(path, heads.get("e"))
    values = _rows(list(rows), sum(len(node.channels) for node in nodes))
    _check_count(path, heads.get("s"), len(values))
    return Content(nodes, rate, values)


def names_of(nodes: Sequence[Node]) -> list[str]:
    """Give every node a name of its own; ends are called after their parents."""
    joints = [node.name for node in nodes if not node.end]
    ends = [f"{nodes[node.parent].name}_end" for node in nodes if node.end]
    given = numbered([*joints, *ends])
    each = iter(given[: len(joints)]), iter(given[len(joints) :])
    return [next(each[node.end]) for node in nodes]


def _nodes(path: Path, lines: list[Line]) -> list[Node]:
    """Read the hierarchy piece by piece: a piece is a brace, or text between braces."""
    pieces = deque(
        (line, piece.strip())
        for line in lines
        for piece in re.findall(r"[{}]|[^{}]+", line.text)
        if piece.strip()
    )
    _cut(pieces, 1)  # HIERARCHY
    nodes: list[Node] = []
    opened: list[int] = []  # the nodes whose braces are open
    while pieces:
        line, piece = pieces.popleft()
        key = piece.split()[0].upper()
        if key == "}":
            if not opened:
                raise line.error("this '}' closes nothing", "Remove it, or restore its '{'")
            opened.pop()
        elif key in ("ROOT", "JOINT", "END"):
            _check_place(line, key, nodes, opened)
            parent = opened[-1] if opened else -1
            name = " ".join(piece.split()[1:])
            if not name:
                raise line.error(f"{key} has no name", "Add its name")
            if not pieces or pieces.popleft()[1] != "{":
                raise line.error(f"'{{' is missing after {piece!r}", "Add the brace")
            opened.append(len(nodes))
            nodes.append(Node(line, name, parent, key == "END"))
        elif key in ("OFFSET", "CHANNELS") and opened:
            pieces.appendleft((line, piece))
            (_offset if key == "OFFSET" else _channels)(pieces, nodes[opened[-1]])
        else:
            raise line.error(
                f"{piece!r} is out of place", "Use ROOT, JOINT, End Site, OFFSET, CHANNELS, { and }"
            )
    if not nodes:
        raise InputError(path, "there is no ROOT", "Give a BVH file with a skeleton")
    if opened:
        node = nodes[opened[-1]]
        raise node.line.error(f"the '{{' of {node.name!r} is not closed", "Restore the lost '}'")
    for node in nodes:
        if not node.offset:
            raise node.line.error(f"{node.name!r} has no OFFSET", "Add the line")
    return nodes


def _check_place(line: Line, key: str, nodes: list[Node], opened: list[int]) -> None:
    """Refuse a second root, and anything outside of the first."""
    if key == "ROOT" and nodes:
        raise line.error(
            "a second ROOT: these are two skeletons in one file", "Cut it into a file for each"
        )
    if (key == "ROOT") == bool(opened):
        raise line.error(f"{key} stands outside of a ROOT", "Put it between the braces of one")


def _cut(pieces: deque[tuple[Line, str]], count: int) -> list[str]:
    """Take words off the piece in front; the rest of its line stays for what comes next."""
    line, piece = pieces.popleft()
    words = piece.split()
    if words[count:]:
        pieces.appendleft((line, " ".join(words[count:])))
    return words[:count]


def _offset(pieces: deque[tuple[Line, str]], node: Node) -> None:
    """Read ``OFFSET x y z``."""
    line = pieces[0][0]
    words = _cut(pieces, 4)
    if len(words) != 4:
        raise line.error("OFFSET has not three numbers", "Give x, y and z")
    node.offset = numbers(line, words[1:], 3)


def _channels(pieces: deque[tuple[Line, str]], node: Node) -> None:
    """Read ``CHANNELS 3 Zrotation Xrotation Yrotation``."""
    line, piece = pieces[0]
    words = piece.split()
    count = int(words[1]) if len(words) > 1 and words[1].isdecimal() else -1
    named = [word for word in words[2:] if _CHANNEL.fullmatch(word)]
    odd = [word for word in words[2 : 2 + max(count, 0)] if word not in named]
    if odd:
        raise line.error(
            f"the channel {odd[0]!r} of {node.name!r} is not known",
            "Use Xposition, Yposition, Zposition, Xrotation, Yrotation and Zrotation",
        )
    if count != len(named):
        declared = words[1] if len(words) > 1 else "none"
        raise line.error(
            f"{declared} channels are declared and {len(named)} named", "Correct the number"
        )
    node.channels = [word.lower() for word in named]
    for channel in node.channels:
        if node.channels.count(channel) > 1:
            axis, kind = channel[0].upper(), channel[1:]
            does = "turns about" if kind == "rotation" else "moves along"
            raise line.error(
                f"{node.name!r} {does} {axis} twice", "Export it with three different axes"
            )
    _cut(pieces, 2 + count)


def _told(line: Line) -> float:
    """Give the number behind the colon of ``Frames:`` or ``Frame Time:``."""
    found = _HEAD.fullmatch(line.text)
    return number(line, found[2] if found else "")


def _rate(path: Path, line: Line | None) -> float:
    """Give the frame rate that a file tells by its frame time in seconds."""
    if line is None:
        raise InputError(path, "there is no line 'Frame Time:'", "Add it, or give frame_rate")
    time = _told(line)
    where = f"{line.path}:{line.number}"
    return nominal(declared_rate(where, 1.0 / time if time > 1e-9 else 0.0, f"frame time {time:g}"))


def _rows(lines: list[Line], width: int) -> Float[np.ndarray, "frame channel"]:
    """Read the frames, one a line."""
    values = np.empty((len(lines), width))
    for row, line in enumerate(lines):
        words = line.words
        try:
            read = list(map(float, words))
        except ValueError:
            read = [number(line, word) for word in words]
        if len(read) != width:
            raise line.error(
                f"{len(read)} values for {width} channels",
                "Restore what is missing or mixed up; every frame stands on one line",
            )
        values[row] = read
        if not np.isfinite(values[row]).all() or "_" in line.text:
            numbers(line, words, width)
    return values


def _check_count(path: Path, line: Line | None, there: int) -> None:
    """Refuse or warn where more or fewer frames are declared than there are."""
    if line is None:
        raise InputError(path, "there is no line 'Frames:' below MOTION", "Add it")
    declared = int(_told(line))
    if not there:
        raise line.error("there are no frames", "Get the file again from where it came from")
    what = f"{declared} frames are declared and {there} are there"
    if abs(declared - there) > 1:
        raise line.error(what, "Get the file again if it breaks off, else correct the number")
    if declared != there:
        warnings.warn(f"{line.path}:{line.number}: {what}", MotionWarning, stacklevel=4)
