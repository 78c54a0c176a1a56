"""Reading ASF, the skeleton file of the Acclaim pair ASF/AMC.

What an ASF file says of a bone, with `axis` in the order XYZ: C = Rz Ry Rx; its
rotation relative to its parent is C B C^T with B = Rz(rz) Ry(ry) Rx(rx); its end is
its start plus its rotation times direction times length, the direction being given
in the rest pose of the whole body. Joint limits are read for errors and dropped.
"""

from collections.abc import Iterator
from pathlib import Path

from ...errors import InputError
from ..skeleton import Joint, Skeleton
from .asf_blocks import (
    Bone,
    Contents,
    check_root,
    read_bones,
    read_hierarchy,
    read_units,
)
from .text import Line, read_lines

_INCH = 0.0254
_SECTIONS = frozenset(
    {":version", ":name", ":units", ":documentation", ":root", ":bonedata", ":hierarchy"}
)


def read_asf(path: str | Path) -> Skeleton:
    """Read a skeleton from an ASF file.

    Parameters
    ----------
    path
        The file; its stem becomes the skeleton's name.

    Returns
    -------
    Skeleton in the file's length unit, with `metres` = 0.0254 / length, as CMU and
    HDM05 mean their ``length 0.45``.

    Raises
    ------
    InputError
        If the file is missing or says something that is wrong, unknown or not
        supported (bones that change their length, axis orders other than XYZ); file
        and line are named.
    """
    path = Path(path)
    contents = Contents()
    lines = [line for line in read_lines(path) if line.words and not line.text.startswith("#")]
    for section, body in _sections(lines):
        if section.words[0] == ":units":
            read_units(body, contents)
        elif section.words[0] == ":root":
            contents.root = {line.words[0].lower(): tuple(line.words[1:]) for line in body}
            check_root(section, body, contents)
        elif section.words[0] == ":bonedata":
            read_bones(body, contents)
        elif section.words[0] == ":hierarchy":
            read_hierarchy(body, contents)
    _check_complete(path, contents)
    return _skeleton(path.stem, contents)


def _sections(lines: list[Line]) -> Iterator[tuple[Line, list[Line]]]:
    """Divide the file at its ``:keyword`` lines."""
    head: Line | None = None
    body: list[Line] = []
    for line in lines:
        if not line.words[0].startswith(":"):
            if head is None:
                raise line.error("it stands before the first section", "Start with :version")
            body.append(line)
            continue
        if line.words[0] not in _SECTIONS:
            raise line.error(
                f"the section {line.words[0]} is not known", f"Use {', '.join(sorted(_SECTIONS))}"
            )
        if head is not None:
            yield head, body
        head, body = line, []
    if head is not None:
        yield head, body


def _check_complete(path: Path, contents: Contents) -> None:
    """Refuse a file that lacks a section or a bone's place in the tree."""
    for section, present in (
        (":units with length", contents.unit),
        (":units with angle", contents.radians),
        (":root", contents.root),
        (":bonedata", contents.bones),
        (":hierarchy", contents.parents),
    ):
        if not present:
            raise InputError(path, f"there is no section {section}", "Give a complete ASF file")
    for bone in contents.bones.values():
        if bone.name not in contents.parents:
            raise bone.line.error(f"the bone {bone.name!r} has no parent", "Add it to :hierarchy")


def _skeleton(name: str, contents: Contents) -> Skeleton:
    """Turn bones into joints, depth first: a joint sits where its bone starts."""
    root = contents.root
    channels = tuple(word.lower() for word in root["order"][:2:-1])
    position = _triple(root["position"], 1.0)
    joints = [Joint("root", -1, position, _triple(root["orientation"], contents.radians), channels)]
    waiting = [(bone, 0) for bone, parent in contents.parents.items() if parent == "root"][::-1]
    while waiting:
        bone, parent = waiting.pop()
        at = len(joints)
        joints.append(_joint(contents.bones[bone], parent, contents.bones.get(joints[parent].name)))
        below = [(child, at) for child, above in contents.parents.items() if above == bone]
        waiting += below[::-1]
        if not below:
            joints.append(Joint(f"{bone}_end", at, _vector(contents.bones[bone])))
    return Skeleton(name, tuple(joints), _INCH / contents.unit)


def _joint(bone: Bone, parent: int, above: Bone | None) -> Joint:
    """Make the joint at the start of `bone`, which is the end of the bone `above` it."""
    offset = (0.0, 0.0, 0.0) if above is None else _vector(above)
    # The file lists what is applied first; channels are in the order of the product.
    x, y, z = bone.axis
    return Joint(bone.name, parent, offset, (x, y, z), bone.dof[::-1])


def _vector(bone: Bone) -> tuple[float, float, float]:
    """Give a bone's end relative to its start in the rest pose."""
    x, y, z = (part * (bone.length or 0.0) for part in bone.direction)
    return (x, y, z)


def _triple(words: tuple[str, ...], unit: float) -> tuple[float, float, float]:
    """Turn three words into numbers."""
    x, y, z = (float(word) * unit for word in words)
    return (x, y, z)
