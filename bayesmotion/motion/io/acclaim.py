"""Writing ASF and AMC files, with every digit, so that they read back the same."""

import math
from pathlib import Path

import numpy as np
import xarray as xr

from ...errors import InputError
from ...files import replacing
from ..dataset import skeleton_of
from ..joining import check_exportable
from ..skeleton import Joint, Skeleton

_INCH = 0.0254


def write_asf(skeleton: Skeleton, path: str | Path) -> None:
    """Write a skeleton as ASF.

    Parameters
    ----------
    skeleton
        Its root must be called ``root`` and have three rotations, every other joint
        must have one end (all children in one place, leaves without rotation called
        ``..._end``) and the length unit must be known: ASF cannot say anything else.
    path
        File to write; it is the old one or the new one, never half of one.

    Raises
    ------
    InputError
        If ASF cannot say this skeleton.
    """
    bones = _bones(skeleton)
    with replacing(path) as temporary:
        temporary.write_text("\n".join(_asf_lines(skeleton, bones)) + "\n", encoding="ascii")


def write_amc(motion: xr.Dataset, path: str | Path) -> None:
    """Write a Motion of one clip as AMC, in degrees.

    Parameters
    ----------
    motion
        One clip without missing values, of a skeleton that `write_asf` can write.
    path
        File to write; it is the old one or the new one, never half of one.

    Raises
    ------
    InputError
        If there are several clips, NaN, or only markers, or ASF cannot say the skeleton.
    """
    check_exportable(motion, "AMC")
    skeleton = skeleton_of(motion)
    _bones(skeleton)
    angle = np.degrees(motion["angle"].sel(dof=list(skeleton.dofs)).values)
    root = motion["root_position"].values
    lines = ["#!written by bayesmotion", ":FULLY-SPECIFIED", ":DEGREES"]
    for number, (row, place) in enumerate(zip(angle, root, strict=True), start=1):
        lines.append(str(number))
        lines += _frame_lines(skeleton, row.tolist(), place.tolist())
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")


def _bones(skeleton: Skeleton) -> dict[str, tuple[float, float, float]]:
    """Give each bone's end relative to its start, or say why ASF cannot."""
    root = skeleton.joints[0]
    if root.name != "root" or len(root.channels) != 3 or skeleton.metres is None:
        raise _unsayable(skeleton, "its root is not 'root' with three rotations, or has no unit")
    for bad in (joint for joint in skeleton if not joint.name.isascii() or " " in joint.name):
        raise _unsayable(skeleton, f"the name {bad.name!r} has letters it does not know")
    bones = {}
    for index, joint in enumerate(skeleton):
        below = [child for child in skeleton if child.parent == index]
        ends = {child.offset for child in below}
        if index == 0 and ends - {(0.0, 0.0, 0.0)}:
            raise _unsayable(skeleton, "bones do not start at the root")
        if index and below:
            bones[joint.name] = _only_end(skeleton, joint, below)
        elif index and (
            joint.channels or joint.name != f"{skeleton.joints[joint.parent].name}_end"
        ):
            raise _unsayable(skeleton, f"the leaf {joint.name!r} is no end of a bone")
    return bones


def _only_end(skeleton: Skeleton, joint: Joint, below: list[Joint]) -> tuple[float, float, float]:
    """Give the one place where all children of a joint are."""
    if len({child.offset for child in below}) != 1:
        raise _unsayable(skeleton, f"the joints below {joint.name!r} are in different places")
    if len(below) > 1 and any(child.name == f"{joint.name}_end" for child in below):
        raise _unsayable(skeleton, f"{joint.name!r} has an end and other joints below it")
    return below[0].offset


def _unsayable(skeleton: Skeleton, why: str) -> InputError:
    """Make the error for a skeleton that is not of the ASF kind."""
    return InputError(
        f"skeleton {skeleton.name!r}", f"ASF cannot say it: {why}", "Write it as BVH instead"
    )


def _asf_lines(skeleton: Skeleton, bones: dict[str, tuple[float, float, float]]) -> list[str]:
    """Give the lines of the file."""
    root = skeleton.joints[0]
    order = "TX TY TZ " + " ".join(reversed(root.channels)).upper()
    lines = [
        "# written by bayesmotion",
        ":version 1.10",
        f":name {skeleton.name}",
        ":units",
        "  mass 1.0",
        f"  length {_INCH / (skeleton.metres or _INCH)!r}",
        "  angle deg",
        ":root",
        f"  order {order}",
        "  axis XYZ",
        f"  position {_words(root.offset)}",
        f"  orientation {_words(_degrees(root.axis))}",
        ":bonedata",
    ]
    turning = [joint for joint in skeleton.joints[1:] if joint.name in bones]
    for number, joint in enumerate(turning, start=1):
        lines += _bone_lines(number, joint, bones[joint.name])
    lines += [":hierarchy", "  begin"]
    for index, joint in enumerate(skeleton):
        below = [child.name for child in turning if child.parent == index]
        if below:
            lines.append(f"    {joint.name} {' '.join(below)}")
    return [*lines, "  end"]


def _bone_lines(number: int, joint: Joint, end: tuple[float, float, float]) -> list[str]:
    """Give the block of one bone."""
    length = math.hypot(*end)
    direction = tuple(part / length for part in end) if length else (0.0, 0.0, 1.0)
    lines = [
        "  begin",
        f"    id {number}",
        f"    name {joint.name}",
        f"    direction {_words(direction)}",
        f"    length {length!r}",
        f"    axis {_words(_degrees(joint.axis))} XYZ",
    ]
    if joint.channels:
        lines.append(f"    dof {' '.join(reversed(joint.channels))}")
    return [*lines, "  end"]


def _frame_lines(skeleton: Skeleton, angle: list[float], root: list[float]) -> list[str]:
    """Give the lines of one frame; AMC lists what is applied first."""
    lines, at = [], 0
    for joint in skeleton:
        values = angle[at : at + len(joint.channels)][::-1]
        at += len(joint.channels)
        if joint.parent < 0:
            values = root + values
        if values:
            lines.append(f"{joint.name} {_words(values)}")
    return lines


def _degrees(angles: tuple[float, ...]) -> tuple[float, ...]:
    """Turn radians into degrees."""
    return tuple(math.degrees(angle) for angle in angles)


def _words(values: tuple[float, ...] | list[float]) -> str:
    """Write numbers so that they read back exactly."""
    return " ".join(repr(float(value)) for value in values)
