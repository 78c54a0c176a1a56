"""The sections of an ASF file, one reader each."""

import math
from dataclasses import dataclass, field

from scipy.spatial.transform import Rotation

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
class Root:
    """The root as the file gives it; angles in radians."""

    order: tuple[str, ...]  # of the values in an AMC file: ("tx", "ty", "tz", "rx", "ry", "rz")
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    axis: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass
class Contents:
    """What has been read of a file."""

    unit: float | None = None  # of length; None where the file does not say
    radians: float = math.radians(1.0)  # in one unit of angle
    root: "Root | None" = None
    bones: dict[str, Bone] = field(default_factory=dict)
    parents: dict[str, str] = field(default_factory=dict)


def read_units(body: list[Line], contents: Contents) -> None:
    """Read the units of length and angle (that of mass means nothing here)."""
    for line in body:
        key, words = line.words[0].lower(), [word.lower() for word in line.words[1:]]
        if key == "length":
            contents.unit = numbers(line, line.words[1:], 1)[0]
            if contents.unit <= 0:
                raise line.error("the length is not positive", "Give for example 'length 0.45'")
        elif key == "angle" and words in (["deg"], ["degrees"], ["rad"], ["radians"]):
            contents.radians = math.radians(1.0) if words[0].startswith("deg") else 1.0
        elif key != "mass":
            raise line.error(
                f"the unit {line.text!r} is not known", "Use mass, length, and angle deg or rad"
            )


def read_root(section: Line, body: list[Line], contents: Contents) -> None:
    """Read the root: in which order an AMC file gives its values, and where it rests."""
    keys = ("order", "axis", "position", "orientation")
    places = {line.words[0].lower(): line for line in body}
    for key, line in places.items():
        if key not in keys:
            raise line.error(f"{line.words[0]!r} is not known of a root", f"Use {', '.join(keys)}")
    if "order" not in places:
        raise section.error("the root has no order", "Add a line 'order TX TY TZ RX RY RZ'")
    root = Root(tuple(word.lower() for word in places["order"].words[1:]))
    turns = [word for word in root.order if word in ("rx", "ry", "rz")]
    if sorted(root.order) != sorted([*set(turns), "tx", "ty", "tz"]):
        raise places["order"].error(
            f"the root's order is {' '.join(root.order)}",
            "Use TX, TY and TZ, and of RX, RY, RZ each at most once, in any order",
        )
    if "position" in places:
        root.position = numbers(places["position"], places["position"].words[1:], 3)
    if "orientation" in places:
        line, axis = places["orientation"], places.get("axis")
        words = axis.words[1:] if axis else ["XYZ"]
        root.axis = _axis(line, [*line.words[1:], *words], contents)
    contents.root = root


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
        bone.limits += line.text.count("(")
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
        bone.limits = max(line.text.count("("), 1)


def _axis(line: Line, words: list[str], contents: Contents) -> tuple[float, ...]:
    """Read angles about x, y, z and the order of turning; give those of the order XYZ, radians."""
    order = words[3].lower() if words[3:] else "xyz"
    if len(words) > 4 or sorted(order) != ["x", "y", "z"]:
        raise line.error(
            "the axis is not three angles and an order such as XYZ", "Use 'axis x y z XYZ'"
        )
    angles = tuple(value * contents.radians for value in numbers(line, words[:3], 3))
    if order == "xyz":
        return angles
    turn = Rotation.from_euler(order, [angles["xyz".index(letter)] for letter in order])
    return tuple(turn.as_euler("xyz").tolist())


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
    """Read the lines ``parent child child ...``, in any order."""
    for line in body:
        names = line.words
        if [name.lower() for name in names] in (["begin"], ["end"]):
            continue
        for name in names:
            if name not in contents.bones and name != "root":
                raise line.error(f"there is no bone {name!r}", "Use the names in :bonedata")
        for name in names[1:]:
            if name in contents.parents or name == "root":
                raise line.error(f"{name!r} already has a parent", "Name each bone once as a child")
            contents.parents[name] = names[0]
