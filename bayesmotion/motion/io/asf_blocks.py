"""The sections of an ASF file, one reader each."""

import math
from dataclasses import dataclass, field

from .text import Line, numbers

_BONE_KEYS = frozenset(
    {"id", "name", "direction", "length", "axis", "dof", "limits", "bodymass", "cofmass"}
)


@dataclass
class Bone:
    """One bone as the file gives it; angles in radians."""

    line: Line
    name: str = ""
    direction: tuple[float, ...] = ()
    length: float | None = None
    axis: tuple[float, ...] = ()
    dof: tuple[str, ...] = ()
    limits: int = 0


@dataclass
class Contents:
    """What has been read of a file."""

    unit: float = 0.0  # of length; zero until the file has said it
    radians: float = 0.0  # in one unit of angle; the same
    root: dict[str, tuple[str, ...]] = field(default_factory=dict)
    bones: dict[str, Bone] = field(default_factory=dict)
    parents: dict[str, str] = field(default_factory=dict)


def read_units(body: list[Line], contents: Contents) -> None:
    """Read the units of length and angle (that of mass means nothing here)."""
    for line in body:
        key = line.words[0]
        if key == "length":
            contents.unit = numbers(line, line.words[1:], 1)[0]
            if contents.unit <= 0:
                raise line.error("the length is not positive", "Give for example 'length 0.45'")
        elif key == "angle" and line.words[1:] in (["deg"], ["rad"]):
            contents.radians = math.radians(1.0) if line.words[1] == "deg" else 1.0
        elif key != "mass":
            raise line.error(
                f"the unit {line.text!r} is not known", "Use mass, length, and angle deg or rad"
            )


def check_root(section: Line, body: list[Line], contents: Contents) -> None:
    """Refuse a root that is incomplete or says what is not supported."""
    keys = ("order", "axis", "position", "orientation")
    places = {line.words[0].lower(): line for line in body}
    for line in body:
        if line.words[0].lower() not in keys:
            raise line.error(f"{line.words[0]!r} is not known of a root", f"Use {', '.join(keys)}")
        if line.words[0].lower() in ("position", "orientation"):
            numbers(line, line.words[1:], 3)
    for key in keys:
        if key not in contents.root:
            raise section.error(f"the root has no {key}", f"Add a line '{key} ...'")
    order = [word.lower() for word in contents.root["order"]]
    if order[:3] != ["tx", "ty", "tz"] or sorted(order[3:]) != ["rx", "ry", "rz"]:
        raise places["order"].error(
            f"the root's order is {' '.join(order)}",
            "Use TX TY TZ and then RX, RY, RZ in any order",
        )
    if contents.root["axis"] != ("XYZ",):
        raise places["axis"].error("the root's axis order is not XYZ", "Rewrite it in XYZ")


def read_bones(body: list[Line], contents: Contents) -> None:
    """Read the begin ... end blocks of the bones."""
    bone: Bone | None = None
    for line in body:
        key = line.words[0].lower()
        if key == "begin" and bone is None:
            bone = Bone(line)
        elif key == "end" and bone is not None:
            _check_bone(bone, contents)
            contents.bones[bone.name] = bone
            bone = None
        elif key in ("begin", "end") or bone is None:
            raise line.error(f"{key!r} is out of place", "Put each bone between begin and end")
        else:
            _read_bone_line(line, bone, contents)
    if bone is not None:
        raise bone.line.error("the bone has no end", "Add a line 'end'")


def _read_bone_line(line: Line, bone: Bone, contents: Contents) -> None:
    """Read one line within a bone."""
    key, words = line.words[0].lower(), line.words[1:]
    if key.startswith("(") and bone.limits:
        bone.limits += 1
    elif key not in _BONE_KEYS:
        raise line.error(f"{key!r} is not known of a bone", f"Use {', '.join(sorted(_BONE_KEYS))}")
    elif key == "name":
        bone.name = " ".join(words)
    elif key == "direction":
        bone.direction = numbers(line, words, 3)
    elif key == "length":
        bone.length = numbers(line, words, 1)[0]
    elif key == "axis":
        bone.axis = _axis(line, words, contents)
    elif key == "dof":
        bone.dof = tuple(word.lower() for word in words)
        if not set(bone.dof) <= {"rx", "ry", "rz"} or len(set(bone.dof)) != len(bone.dof):
            raise line.error(
                f"the degrees of freedom are {' '.join(words)}",
                "Use rx, ry, rz, each at most once; bones that move along are not supported",
            )
    elif key == "limits":
        bone.limits = 1


def _axis(line: Line, words: list[str], contents: Contents) -> tuple[float, ...]:
    """Read the axis of a bone as radians."""
    if words[3:] != ["XYZ"]:
        raise line.error("the axis is not three angles in the order XYZ", "Use 'axis x y z XYZ'")
    if not contents.radians:
        raise line.error("the unit of angle is not known yet", "Put 'angle deg' in :units above")
    unit = contents.radians
    return tuple(value * unit for value in numbers(line, words[:3], 3))


def _check_bone(bone: Bone, contents: Contents) -> None:
    """Refuse a bone that is incomplete or stands twice."""
    for what in ("name", "direction", "length", "axis"):
        if getattr(bone, what) in ("", (), None):
            raise bone.line.error(f"the bone has no {what}", f"Add a line '{what} ...'")
    if bone.name in contents.bones or bone.name == "root":
        raise bone.line.error(f"the bone {bone.name!r} stands twice", "Rename one")
    if bone.limits and bone.limits != len(bone.dof):
        raise bone.line.error(
            f"{bone.limits} limits for {len(bone.dof)} degrees of freedom", "Give one pair for each"
        )


def read_hierarchy(body: list[Line], contents: Contents) -> None:
    """Read the lines ``parent child child ...``."""
    for line in body:
        names = line.words
        if names in (["begin"], ["end"]):
            continue
        for name in names:
            if name not in contents.bones and name != "root":
                raise line.error(f"there is no bone {name!r}", "Use the names in :bonedata")
        if names[0] != "root" and names[0] not in contents.parents:
            raise line.error(
                f"{names[0]!r} is not connected yet", "Sort the lines from the root on"
            )
        for name in names[1:]:
            if name in contents.parents or name == "root":
                raise line.error(f"{name!r} already has a parent", "Name each bone once as a child")
            contents.parents[name] = names[0]
