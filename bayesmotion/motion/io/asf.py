"""Reading ASF, the skeleton file of the Acclaim pair ASF/AMC.

What an ASF file says of a bone: C = Rz Ry Rx of its `axis` in the order XYZ; its
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
    Root,
    read_bones,
    read_hierarchy,
    read_root,
    read_units,
)
from .text import Line, read_lines, without_comments

_INCH = 0.0254
_SECTIONS = frozenset(
    {":version", ":name", ":units", ":documentation", ":root", ":bonedata", ":hierarchy", ":skin"}
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
    HDM05 mean their ``length 0.45``; None where the file says no length.

    Raises
    ------
    InputError
        If the file is missing or says something that is wrong, unknown or not
        supported (bones that change their length); file and line are named.
    """
    return read_body(path)[0]


def read_body(path: str | Path) -> tuple[Skeleton, tuple[str, ...]]:
    """Read a skeleton, and the order of the root's values in AMC files; as `read_asf`."""
    path = Path(path)
    contents = Contents()
    sections = list(_sections(without_comments(read_lines(path))))
    readers = {":bonedata": read_bones, ":hierarchy": read_hierarchy, ":units": read_units}
    # What others need comes first, wherever it stands.
    for name in (":units", ":root", ":bonedata", ":hierarchy"):
        for section, body in sections:
            if section.words[0].lower() != name:
                continue
            if name == ":root":
                read_root(section, body, contents)
            else:
                readers[name](body, contents)
    root = _check_complete(path, contents)
    return _skeleton(path.stem, contents, root), root.order


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
        if line.words[0].lower() not in _SECTIONS:
            raise line.error(
                f"the section {line.words[0]} is not known", f"Use {', '.join(sorted(_SECTIONS))}"
            )
        if head is not None:
            yield head, body
        head, body = line, []
    if head is not None:
        yield head, body


def _check_complete(path: Path, contents: Contents) -> Root:
    """Refuse a file that lacks a section or a bone's place in the tree; give the root."""
    for section, present in (
        (":root", contents.root),
        (":bonedata", contents.bones),
        (":hierarchy", contents.parents),
    ):
        if not present:
            raise InputError(path, f"there is no section {section}", "Give a complete ASF file")
    for bone in contents.bones.values():
        above = [bone.name]
        while (parent := contents.parents.get(above[-1])) is not None and parent not in above:
            above.append(parent)
        if above[-1] != "root":
            lost = "no parent" if len(above) == 1 else "no way up to the root"
            raise bone.line.error(f"the bone {bone.name!r} has {lost}", "Add it to :hierarchy")
    assert contents.root is not None
    return contents.root


def _skeleton(name: str, contents: Contents, root: Root) -> Skeleton:
    """Turn bones into joints, depth first: a joint sits where its bone starts."""
    channels = tuple(word for word in reversed(root.order) if word.startswith("r"))
    joints = [Joint("root", -1, _triple(root.position), _triple(root.axis), channels)]
    waiting = [(bone, 0) for bone, parent in contents.parents.items() if parent == "root"][::-1]
    while waiting:
        bone, parent = waiting.pop()
        at = len(joints)
        joints.append(_joint(contents.bones[bone], parent, contents.bones.get(joints[parent].name)))
        below = [(child, at) for child, above in contents.parents.items() if above == bone]
        waiting += below[::-1]
        if not below:
            joints.append(Joint(f"{bone}_end", at, _vector(contents.bones[bone])))
    return Skeleton(name, tuple(joints), contents.unit and _INCH / contents.unit)


def _joint(bone: Bone, parent: int, above: Bone | None) -> Joint:
    """Make the joint at the start of `bone`, which is the end of the bone `above` it."""
    offset = (0.0, 0.0, 0.0) if above is None else _vector(above)
    # The file lists what is applied first; channels are in the order of the product.
    return Joint(bone.name, parent, offset, _triple(bone.axis), bone.dof[::-1])


def _vector(bone: Bone) -> tuple[float, float, float]:
    """Give a bone's end relative to its start in the rest pose."""
    x, y, z = (part * (bone.length or 0.0) for part in bone.direction)
    return (x, y, z)


def _triple(values: tuple[float, ...]) -> tuple[float, float, float]:
    """Give three numbers as such."""
    x, y, z = values
    return (x, y, z)
