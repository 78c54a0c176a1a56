"""Reading AMC, the motion file of the Acclaim pair ASF/AMC."""

import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from ...errors import InputError, MotionWarning
from ..dataset import make_motion
from ..skeleton import Skeleton
from .asf import read_body
from .rates import declared_rate
from .text import Line, numbers, read_lines, without_comments

FRAME_RATE = 120.0


@dataclass(frozen=True)
class _Header:
    """What stands above the frames: radians in the unit of angle, rate, index of frame one."""

    radians: float
    rate: float
    all_turn: bool  # every bone has three rotations, whatever its degrees of freedom
    start: int


@dataclass(frozen=True)
class _Frame:
    """One frame: the line with its number, its values in the order of the columns, bones left out.

    Values of bones that are left out are NaN.
    """

    line: Line
    values: list[float]
    left: set[str]


def read_amc(
    path: str | Path,
    skeleton: Skeleton | str | Path | None = None,
    *,
    frame_rate: float | None = None,
    clip: str | None = None,
    labels: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Read a motion from an AMC file.

    Parameters
    ----------
    path
        The file.
    skeleton
        Skeleton, or its ASF file. By default the ASF file is looked for in the same
        folder: ``02.asf`` for ``02_01.amc``, ``HDM_bk.asf`` for ``HDM_bk_...amc``,
        that which the file's first line names, else the only one there, with a warning; but
        not another person's by its number.
    frame_rate
        Frames a second. Most AMC files do not say; 120 is what CMU and HDM05 recorded with.
    clip
        Name of the clip, by default the file's stem.
    labels
        What is known of the clip; the subject is by default the skeleton's name
        (without the ``HDM_`` of HDM05).

    Returns
    -------
    Motion of one clip, in radians and the skeleton's length unit. The angles of a bone that no
    frame has are missing (NaN), with a warning; a bone that some frames have and others have not
    is an error.

    Warns
    -----
    MotionWarning
        Of bones that no frame has, and of a skeleton that is only taken since it is the only
        one in the folder.

    Raises
    ------
    InputError
        If a file is missing or anything in it is not as it should be; file and line
        are named.
    """
    path = Path(path)
    text = read_lines(path)
    lines = without_comments(text)
    if isinstance(skeleton, Skeleton):
        order = ("tx", "ty", "tz", *reversed(skeleton.joints[0].channels))
    else:
        skeleton, order = read_body(_find_asf(path, text) if skeleton is None else skeleton)
    header = _header(path, lines)
    if header.all_turn:
        skeleton = _all_turning(skeleton, {line.words[0] for line in lines[header.start :]})
    frames = list(_frames(lines[header.start :], _columns(skeleton, order)))
    _check_whole(path, frames, skeleton.joints[0].name)
    _check_frames(frames)
    values = np.array([frame.values for frame in frames])
    return make_motion(
        skeleton,
        values[:, 3:] * header.radians,
        values[:, :3],
        frame_rate=header.rate if frame_rate is None else frame_rate,
        clip=path.stem if clip is None else clip,
        labels={"subject": skeleton.name.removeprefix("HDM_"), **(labels or {})},
        source=path.name,
        allow_missing=True,
    )


def _find_asf(path: Path, lines: list[Line]) -> Path:
    """Find the skeleton that belongs to an AMC file, whatever the case of its name."""
    parts = path.stem.split("_")
    names = [f"{parts[0]}.asf"]
    if parts[0] == "HDM" and len(parts) > 1:
        names.insert(0, f"HDM_{parts[1]}.asf")
    if told := re.search(r"([^\\/\s]+\.asf)\s*$", lines[0].text, re.IGNORECASE):
        names.append(told[1])
    there = sorted(file for file in path.parent.glob("*") if file.suffix.lower() == ".asf")
    for name in names:
        for file in there:
            if file.name.lower() == name.lower():
                return file
    if len(there) == 1 and not (parts[0].isdigit() and there[0].stem.isdigit()):
        warnings.warn(
            f"{path}: {there[0].name} is taken for its skeleton, the only one there; give the "
            "skeleton if it is another's",
            MotionWarning,
            stacklevel=4,
        )
        return there[0]
    raise InputError(
        path,
        f"its skeleton is not known: there is no {' or '.join(dict.fromkeys(names))} beside it, "
        f"and {len(there)} other .asf files",
        "Give the skeleton, in Python skeleton='02.asf', in a shell --skeleton 02.asf",
    )


def _header(path: Path, lines: list[Line]) -> _Header:
    """Read up to the first frame."""
    radians, rate, all_turn = None, FRAME_RATE, False
    for index, line in enumerate(lines):
        if not line.text.startswith(":"):
            if radians is None:
                raise line.error(
                    "neither :DEGREES nor :RADIANS stands above the first frame", "Add the line"
                )
            return _Header(radians, rate, all_turn, index)
        keyword, *words = line.words
        match keyword.upper():
            case ":DEGREES" | ":RADIANS":
                radians = math.radians(1.0) if keyword.upper() == ":DEGREES" else 1.0
            case ":SAMPLES-PER-SECOND":
                (rate,) = numbers(line, words, 1)
                declared_rate(f"{line.path}:{line.number}", rate, line.text)
            case ":FORCE-ALL-JOINTS-BE-3DOF":
                all_turn = True
            case ":FULLY-SPECIFIED":
                pass
            case _:
                raise line.error(
                    f"the keyword {line.text} is not known",
                    "Use :FULLY-SPECIFIED, :SAMPLES-PER-SECOND, :FORCE-ALL-JOINTS-BE-3DOF, "
                    ":DEGREES or :RADIANS",
                )
    raise InputError(path, "there are no frames", "Get the file again from where it came from")


def _all_turning(skeleton: Skeleton, bones: set[str]) -> Skeleton:
    """Give the bones that a file has values for three rotations each."""
    joints = [
        replace(joint, channels=("rz", "ry", "rx"))
        if joint.name in bones and joint.parent >= 0 and len(joint.channels) < 3
        else joint
        for joint in skeleton
    ]
    return replace(skeleton, joints=tuple(joints))


def _columns(skeleton: Skeleton, order: Sequence[str]) -> dict[str, list[int]]:
    """Say where each bone's values go: root path first, then `skeleton.dofs`.

    An AMC file lists what is applied first, a skeleton the order of the product; `order` is
    that of the root's values.
    """
    places: dict[str, list[int]] = {}
    at = 3
    for joint in skeleton:
        if joint.channels:
            places[joint.name] = list(range(at, at + len(joint.channels)))[::-1]
            at += len(joint.channels)
    root = skeleton.joints[0].name
    turns = iter(places.get(root, []))
    where = {word: "xyz".index(word[1]) for word in order if word in ("tx", "ty", "tz")}
    places[root] = [where[word] if word in where else next(turns) for word in order]
    return places


def _frames(lines: list[Line], columns: dict[str, list[int]]) -> Iterator[_Frame]:
    """Read frame after frame."""
    width = sum(len(places) for places in columns.values())
    frame = None
    for line in lines:
        words = line.words
        if len(words) == 1 and words[0].isdigit():
            if frame is not None:
                yield frame
            frame = _Frame(line, [math.nan] * width, set(columns))
            continue
        if frame is None:
            raise line.error("it stands before the first frame number", "Start with the number 1")
        _read_bone(line, words, frame, columns)
    if frame is not None:
        yield frame


def _read_bone(line: Line, words: list[str], frame: _Frame, columns: dict[str, list[int]]) -> None:
    """Read the values of one bone into the frame."""
    bone = words[0]
    if bone not in columns:
        raise line.error(
            f"the skeleton has no bone {bone!r} that turns", "Give the skeleton of this recording"
        )
    if bone not in frame.left:
        raise line.error(
            f"the bone {bone!r} stands twice in frame {frame.line.text}", "Remove one line"
        )
    frame.left.discard(bone)
    values = numbers(line, words[1:], len(columns[bone]))
    for place, value in zip(columns[bone], values, strict=True):
        frame.values[place] = value


def _check_whole(path: Path, frames: list[_Frame], root: str) -> None:
    """Refuse a frame that lacks the root or a bone that others have; warn of what none has."""
    never = set.intersection(*(frame.left for frame in frames)) - {root}
    for frame in frames:
        left = frame.left - never
        if left:
            prefix = "the file breaks off: " if len(frames) > 1 and frame is frames[-1] else ""
            raise frame.line.error(
                f"{prefix}frame {frame.line.text} has no values for {', '.join(sorted(left))}",
                "Complete the frame or cut it off, or give the skeleton of this recording",
            )
    if never:
        warnings.warn(
            f"{path}: no frame has values for {', '.join(sorted(never))}: they are missing (NaN)",
            MotionWarning,
            stacklevel=3,
        )


def _check_frames(frames: list[_Frame]) -> None:
    """Refuse frame numbers that do not count up by one."""
    first = int(frames[0].line.text)
    for expected, frame in enumerate(frames, start=first):
        if int(frame.line.text) != expected:
            raise frame.line.error(
                f"frame {frame.line.text} stands where frame {expected} belongs",
                "Restore the missing frames, or number them anew if none is missing",
            )
