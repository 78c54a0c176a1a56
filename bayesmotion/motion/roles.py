"""Which joint is which: pelvis, spine, head and limbs of bodies of any convention.

Joints are found by their names, whatever stands before these (`mixamorig:`, `Bip01`) and however
they tell a side (`sides`), and by the tree: the spine is what lies between pelvis and neck,
whatever it is called, and a joint of a limb that is called otherwise lies next to those that
are known. Known are the names of CMU's ASF and of its BVH releases, of Mixamo, MotionBuilder
(HumanIK), Xsens, Rokoko, Bandai-Namco, 3ds Max Biped, Unreal, Blender, OpenSim and SMPL.
Anything can be said instead: `with_joints`.
"""

import csv
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from ..errors import InputError
from .dataset import skeleton_of, skeletons
from .io.text import read_lines
from .sides import Side, sides, without_side
from .skeleton import Skeleton

# What joints are called, in small letters without side, signs and numbers. The plainest first:
# where there is a thigh, the hip is something else.
NAMES: dict[str, tuple[str, ...]] = {
    "pelvis": ("pelvis", "hips", "hip"),
    "neck": ("neck",),
    "head": ("head",),
    "hip": ("femur", "thigh", "upleg", "upperleg", "hip"),
    "knee": ("knee", "tibia", "shin", "calf", "shank", "lowerleg", "lowleg", "leg"),
    "ankle": ("ankle", "talus", "foot"),
    "toes": ("toes", "toe", "toebase", "ball", "foot"),
    "shoulder": ("humerus", "upperarm", "uparm", "arm", "shoulder"),
    "elbow": ("elbow", "ulna", "radius", "forearm", "lowerarm", "lowarm"),
    "wrist": ("wrist", "hand"),
    "fingers": ("fingers", "middle", "handmiddle", "hand"),
}
_ALL = {name for names in NAMES.values() for name in names}
SIDES: tuple[Side, ...] = ("left", "right")
# Three joints of a limb, from the trunk on, and the end of its last bone.
LIMBS = {"leg": ("hip", "knee", "ankle", "toes"), "arm": ("shoulder", "elbow", "wrist", "fingers")}
TRUNK = ("pelvis", "lower back", "upper back", "chest", "neck", "head", "head top")
ROLES = (
    *TRUNK,
    *(f"{side} {part}" for parts in LIMBS.values() for side in SIDES for part in parts),
)
Find = Callable[[str, Callable[[], int | None]], int | None]


def joint_roles(body: xr.Dataset | Skeleton) -> dict[str, str]:
    """Return the joint of every role that is found, by name.

    Parameters
    ----------
    body
        A skeleton, or a Motion of one.

    Returns
    -------
    Names of joints by role (`ROLES`). The spine's joints are shared out between lower back,
    upper back and chest, the first and the last one to the first and the last: a spine of one
    joint has all three roles.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> _, walks = bm.example("multifactor")
    >>> roles = bm.joint_roles(next(iter(bm.split(walks).values())))
    >>> roles["left knee"], roles["chest"]
    ('ltibia', 'thorax')
    """
    skeleton = body if isinstance(body, Skeleton) else skeleton_of(body)
    given = {role: skeleton.index(name) for role, name in skeleton.roles}
    called = _called(skeleton)

    def find(role: str, guess: Callable[[], int | None]) -> int | None:
        return given[role] if role in given else guess()

    places: dict[str, int | None] = {}
    for side in SIDES:
        for parts in LIMBS.values():
            places |= _limb(skeleton, called, find, side, parts)
    places |= _trunk(skeleton, called, find, places)
    named = {role: places.get(role) for role in ROLES}
    return {role: skeleton.names[at] for role, at in named.items() if at is not None}


def required_joints(skeleton: Skeleton, roles: Iterable[str]) -> dict[str, str]:
    """Return the joints of some roles by name.

    Raises
    ------
    InputError
        If one is not found.
    """
    found = joint_roles(skeleton)
    lacking = [role for role in roles if role not in found]
    if lacking:
        raise InputError(
            f"skeleton {skeleton.name!r}",
            f"no joint is found for {', '.join(lacking)} among {', '.join(skeleton.names)}",
            f"Say which it is: read(file, joints={{{lacking[0]!r}: name}}), or --joints with a csv "
            f"table role,joint",
        )
    return {role: found[role] for role in roles}


def hips_and_waist(skeleton: Skeleton) -> tuple[int, int, int]:
    """Return the left hip, the right hip, and the lowest joint of the spine above the pelvis.

    Raises
    ------
    InputError
        If one is not found, or the whole spine is in the place of the pelvis.
    """
    needed = ("pelvis", "left hip", "right hip", "chest")
    pelvis, left, right, chest = (
        skeleton.index(name) for name in required_joints(skeleton, needed).values()
    )
    neck = skeleton.index(joint_roles(skeleton).get("neck", skeleton.names[chest]))
    for index in ancestors(skeleton, neck)[::-1]:
        if index > pelvis and any(skeleton.joints[index].offset):
            return left, right, index
    raise InputError(
        f"skeleton {skeleton.name!r}",
        f"its spine has no length from {skeleton.names[pelvis]} to {skeleton.names[neck]}",
        "Say which joints they are: with_joints(motion, {'neck': name})",
    )


def with_joints(motion: xr.Dataset, joints: Mapping[str, str] | str | Path) -> xr.Dataset:
    """Return a Motion that says which joints are which, whatever their names tell.

    Parameters
    ----------
    motion
        Motion of one or more clips.
    joints
        Names of joints by role (`ROLES`), of as many roles as need it, or a csv table of them
        with the columns ``role`` and ``joint``. Of several skeletons those are meant that have
        these joints.

    Raises
    ------
    InputError
        If there is no such role, or no skeleton that has all these joints.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> _, walks = bm.example("multifactor")
    >>> walk = next(iter(bm.split(bm.with_joints(walks, {"chest": "upperback"})).values()))
    >>> bm.joint_roles(walk)["chest"]
    'upperback'
    """
    where = "joints" if isinstance(joints, Mapping) else joints
    roles = joints if isinstance(joints, Mapping) else _read_table(Path(joints))
    for role in roles:
        if role not in ROLES:
            raise InputError(where, f"there is no role {role!r}", f"Use {', '.join(ROLES)}")
    bodies = skeletons(motion)
    meant = {name for name, body in bodies.items() if set(roles.values()) <= set(body.names)}
    if not meant:
        body = next(iter(bodies.values()))
        lacking = [joint for joint in roles.values() if joint not in body.names]
        raise InputError(
            where,
            f"skeleton {body.name!r} has no joint {', '.join(lacking)}",
            f"Use its joints: {', '.join(body.names)}",
        )
    made = {
        name: replace(body, roles=tuple(sorted({**dict(body.roles), **roles}.items())))
        if name in meant
        else body
        for name, body in bodies.items()
    }
    stored = {name: json.loads(body.to_json()) for name, body in made.items()}
    return motion.assign_attrs(skeletons=json.dumps(stored))


def ancestors(skeleton: Skeleton, index: int) -> list[int]:
    """Return a joint and all it hangs on, up to the root."""
    found = [index]
    while skeleton.joints[found[-1]].parent >= 0:
        found.append(skeleton.joints[found[-1]].parent)
    return found


def _called(skeleton: Skeleton) -> tuple[tuple[Side, str], ...]:
    """Return the side of every joint, and the longest known name that its own ends in."""
    whose = sides(skeleton.names)
    bare = [
        without_side(name) if side != "centre" else "".join(filter(str.isalpha, name.casefold()))
        for name, side in zip(skeleton.names, whose, strict=True)
    ]
    known = [max((n for n in _ALL if name.endswith(n)), key=len, default="") for name in bare]
    return tuple(zip(whose, known, strict=True))


def _named(
    called: tuple[tuple[Side, str], ...], side: str, part: str, among: Iterable[int]
) -> int | None:
    """Return the joint among some that is called as a part, by the plainest name there is."""
    places = list(among)
    for name in NAMES[part]:
        for place in places:
            if called[place] == (side, name):
                return place
    return None


def _limb(
    skeleton: Skeleton, called: tuple[tuple[Side, str], ...], find: Find, side: str,
    parts: tuple[str, ...],
) -> dict[str, int | None]:  # fmt: skip
    """Return the joints of a limb by role: by name, the middle one apart also by the tree."""
    roles = [f"{side} {part}" for part in parts]

    def above() -> int | None:
        if middle is None:
            return None
        over = ancestors(skeleton, middle)[1:]
        named = _named(called, side, parts[0], over)
        upper = named if named is not None else next(iter(over), None)
        return upper or None  # a limb does not begin at the root

    def below(start: int | None, part: str) -> int | None:
        if start is None:
            return None
        under = [i for i in range(start + 1, len(skeleton)) if start in ancestors(skeleton, i)]
        named = _named(called, side, part, under)
        return named if named is not None else lowest(skeleton, start)

    middle = find(roles[1], lambda: _named(called, side, parts[1], range(len(skeleton))))
    upper = find(roles[0], above)
    lower = find(roles[2], lambda: below(middle, parts[2]))
    if upper is None or middle is None or lower is None:
        return {role: find(role, lambda: None) for role in roles}
    end = find(roles[3], lambda: below(lower, parts[3]))
    return dict(zip(roles, (upper, middle, lower, end), strict=True))


def lowest(skeleton: Skeleton, index: int, among: Iterable[int] | None = None) -> int | None:
    """Return the joint at the other end of a joint's longest bone, None where it has none."""
    places = range(len(skeleton)) if among is None else among
    ends = [
        (float(np.linalg.norm(skeleton.joints[number].offset)), -number)
        for number in places
        if skeleton.joints[number].parent == index
    ]
    ends = [end for end in ends if end[0] > 0.0]
    return -max(ends)[1] if ends else None


def _trunk(
    skeleton: Skeleton, called: tuple[tuple[Side, str], ...], find: Find,
    limbs: Mapping[str, int | None],
) -> dict[str, int | None]:  # fmt: skip
    """Return the joints from the pelvis to the top of the head by role."""
    hips, shoulders = (
        _shared(skeleton, [limbs[f"{side} {part}"] for side in SIDES])
        for part in ("hip", "shoulder")
    )
    centre = [place for place, (side, _) in enumerate(called) if side == "centre"]
    # The pelvis is called so, or it is what both legs hang on.
    over = [] if hips is None else ancestors(skeleton, hips)
    pelvis = find("pelvis", lambda: _first(_named(called, "centre", "pelvis", over), hips))
    head = find("head", lambda: _named(called, "centre", "head", centre))
    found = {"pelvis": pelvis, "head": head}
    if head is not None:
        tops = [place for place in centre if place != head]
        found["head top"] = find("head top", lambda: lowest(skeleton, head, tops))
    if pelvis is None or head is None:
        return found
    chain = ancestors(skeleton, head)[::-1][:-1]
    chain = chain[chain.index(pelvis) + 1 :] if pelvis in chain else []
    # The neck is called so, or it is what comes after that which both arms hang on.
    after = chain[chain.index(shoulders) + 1 :] if shoulders in chain else []
    named = _named(called, "centre", "neck", chain)
    neck = find("neck", lambda: _first(named, next(iter(after), None)))
    found["neck"] = neck
    spine = chain[: chain.index(neck)] if neck in chain else chain
    spine = [place for place in spine if skeleton.joints[place].channels]
    parts = (spine[0], spine[len(spine) // 2], spine[-1]) if spine else (None, None, None)
    for role, place in zip(("lower back", "upper back", "chest"), parts, strict=True):
        found[role] = find(role, lambda place=place: place)
    return found


def _shared(skeleton: Skeleton, places: list[int | None]) -> int | None:
    """Return the lowest joint that all of some joints hang on."""
    lines = [ancestors(skeleton, place) for place in places if place is not None]
    if len(lines) < len(places):
        return None
    return next(place for place in lines[0] if all(place in line for line in lines))


def _first(*places: int | None) -> int | None:
    return next((place for place in places if place is not None), None)


def _read_table(path: Path) -> dict[str, str]:
    """Read a table of roles and joints."""
    rows = csv.reader(line.text for line in read_lines(path) if line.text)
    rows = [[cell.strip() for cell in row] for row in rows]
    if not rows or rows[0] != ["role", "joint"] or any(len(row) != 2 for row in rows):
        raise InputError(
            path, "it is no table of the columns role and joint", "Write role,joint in each line"
        )
    return {row[0]: row[1] for row in rows[1:]}
