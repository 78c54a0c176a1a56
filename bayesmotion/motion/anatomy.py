"""Angles that are spoken of in anatomy, in degrees, of bodies of any convention.

Joints are found by `joint_roles`. Angles come from the places of joints alone, so that neither
rest pose nor order of rotations counts:

    knee, elbow flexion           0 for a straight limb
    hip, shoulder flexion         of thigh and upper arm from the trunk's axis, forwards positive
    hip, shoulder abduction       the same to the side, away from the body positive
    ankle dorsiflexion            0 for a foot at a right angle to the shank, toes up positive
    trunk flexion                 from the vertical, forwards positive

The trunk's axis goes from the middle of the hips to that of the shoulders, its right from the
left hip to the right one.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .roles import LIMBS, NAMES, SIDES, joint_roles
from .sides import Side
from .skeleton import Skeleton

Place = Float[np.ndarray, "n 3"]


@dataclass(frozen=True)
class Limb:
    """Three joints of a limb, and where its last bone points (None where it has no end)."""

    upper: int
    middle: int
    lower: int
    end: int | None


def limbs_of(skeleton: Skeleton) -> dict[tuple[Side, str], Limb]:
    """Return arms and legs by side and ``"arm"`` or ``"leg"``, those that are found."""
    return dict(_limbs(skeleton))


@lru_cache(maxsize=64)
def _limbs(skeleton: Skeleton) -> dict[tuple[Side, str], Limb]:
    found: dict[tuple[Side, str], Limb] = {}
    place = {role: skeleton.index(name) for role, name in joint_roles(skeleton).items()}
    for kind, parts in LIMBS.items():
        for side in SIDES:
            upper, middle, lower, end = (place.get(f"{side} {part}") for part in parts)
            if upper is not None and middle is not None and lower is not None:
                found[side, kind] = Limb(upper, middle, lower, end)
    return found


def anatomical_angles(
    skeleton: Skeleton, where: Float[np.ndarray, "n joint 3"]
) -> dict[str, Float[np.ndarray, " n"]]:
    """Return anatomical angles in degrees by name, such as ``left knee flexion``.

    Parameters
    ----------
    skeleton
        The body.
    where
        Places of its joints in N poses, y up, in any unit. NaN where not known.

    Raises
    ------
    InputError
        If the skeleton has no knees or elbows that are called so.
    """
    limbs = limbs_of(skeleton)
    if not limbs:
        raise InputError(
            f"skeleton {skeleton.name!r}",
            f"none of {', '.join(skeleton.names)} is called as a knee or an elbow",
            f"Name joints as in LeftKnee, {', '.join(NAMES['knee'][:3])} or "
            f"{', '.join(NAMES['elbow'][:3])}, or say which they are: with_joints(motion, ...)",
        )
    out: dict[str, np.ndarray] = {}
    for (side, kind), limb in limbs.items():
        thigh, shank = (_way(where, a, b) for a, b in _bones(limb))
        out[f"{side} {'knee' if kind == 'leg' else 'elbow'} flexion"] = _between(thigh, shank)
        if kind == "leg" and limb.end is not None:
            foot = _way(where, limb.lower, limb.end)
            out[f"{side} ankle dorsiflexion"] = 90.0 - _between(-shank, foot)
    if all((side, kind) in limbs for side in SIDES for kind in ("arm", "leg")):
        out |= _about_trunk(limbs, where)
    return {name: out[name] for name in sorted(out, key=_order)}


def _about_trunk(
    limbs: Mapping[tuple[Side, str], Limb], where: Float[np.ndarray, "n joint 3"]
) -> dict[str, np.ndarray]:
    hips, shoulders = (
        [where[:, limbs[side, kind].upper] for side in SIDES] for kind in ("leg", "arm")
    )
    up = _unit((shoulders[0] + shoulders[1]) - (hips[0] + hips[1]))
    right = hips[1] - hips[0]
    right = _unit(right - _dot(right, up)[:, None] * up)
    ahead = np.cross(up, right)
    out = {}
    for (side, kind), limb in limbs.items():
        bone = _way(where, limb.upper, limb.middle)
        name = f"{side} {'hip' if kind == 'leg' else 'shoulder'}"
        outwards = _dot(bone, right) * (1.0 if side == "right" else -1.0)
        out[f"{name} flexion"] = np.degrees(np.arctan2(_dot(bone, ahead), -_dot(bone, up)))
        out[f"{name} abduction"] = np.degrees(np.arcsin(np.clip(outwards, -1.0, 1.0)))
    level = np.array([0.0, 1.0, 0.0])
    forwards = _unit(np.cross(level, right))
    out["trunk flexion"] = np.degrees(np.arctan2(_dot(up, forwards), up[:, 1]))
    return out


def _order(name: str) -> tuple[int, str]:
    """Put legs before arms, and the left beside the right."""
    parts = ("hip", "knee", "ankle", "trunk", "shoulder", "elbow")
    place = next(i for i, part in enumerate(parts) if part in name)
    return place, " ".join(name.split()[::-1])


def _bones(limb: Limb) -> tuple[tuple[int, int], tuple[int, int]]:
    return (limb.upper, limb.middle), (limb.middle, limb.lower)


def _way(where: np.ndarray, start: int, end: int) -> Place:
    return _unit(where[:, end] - where[:, start])


def _between(one: Place, other: Place) -> Float[np.ndarray, " n"]:
    """Return the angle between two unit vectors, in degrees."""
    cross = np.linalg.norm(np.cross(one, other), axis=1)
    return np.degrees(np.arctan2(cross, _dot(one, other)))


def _dot(one: np.ndarray, other: np.ndarray) -> Float[np.ndarray, " n"]:
    return np.sum(one * other, axis=-1)


def _unit(vector: Place) -> Place:
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-12)
