"""A body of ellipsoids and spheres on any skeleton, moved by any motion.

Every bone carries an ellipsoid along it, the trunk and the head wide ones across it,
and the limbs a sphere where they begin. An ellipsoid is its centre c and the matrix
B = R diag(r^2) R^T of its squared half axes:

    (x - c)^T B^-1 (x - c) <= 1

How thick a part is, in statures, follows from its joint's name; the numbers are round
ones for a lean adult and not measured from anybody.
"""

import re
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ...errors import InputError
from ...motion import Skeleton, skeleton_of
from ...motion.features import check_one_clip
from ...motion.kinematics import poses

# Height of a body whose skeleton does not say its unit, in metres.
STATURE = 1.7
# Bones shorter than this, in statures, carry nothing.
SHORTEST = 0.015


class Part(NamedTuple):
    """How thick a part of the body is, in statures.

    across, deep
        Half axes to the side and to the front.
    beyond
        By how much the ellipsoid reaches beyond both ends of the bone.
    round
        Whether a sphere stands where the bone begins.
    """

    names: str
    across: float
    deep: float
    beyond: float
    round: bool


# The first whose names are in the joint's name counts. "up" and "fore" come before the
# "leg" and "arm" they are part of.
PARTS = (
    Part("finger|thumb|index|pinky|ring|middle", 0.0, 0.0, 0.0, False),
    Part("toe", 0.020, 0.016, 0.010, False),
    Part("foot|ankle", 0.026, 0.022, 0.012, True),
    Part("hipjoint|pelvis", 0.055, 0.060, 0.030, False),
    Part("femur|thigh|up.?leg|hip$", 0.046, 0.048, 0.022, True),
    Part("tibia|shin|calf|knee|leg", 0.032, 0.034, 0.015, True),
    Part("hand|wrist", 0.024, 0.020, 0.020, False),
    Part("radius|ulna|fore.?arm|elbow", 0.024, 0.024, 0.012, True),
    Part("clavicle|collar", 0.035, 0.035, 0.020, False),
    Part("humerus|shoulder|arm", 0.030, 0.030, 0.015, True),
    Part("head", 0.046, 0.056, 0.035, False),
    Part("neck", 0.032, 0.034, 0.020, False),
    Part("back|thorax|spine|chest|abdomen|torso|hips|root", 0.092, 0.064, 0.040, False),
)
OTHER = Part("", 0.025, 0.025, 0.010, False)


@dataclass(frozen=True)
class Body:
    """Ellipsoids on a skeleton, in metres, each turning with one joint.

    skeleton
        The tree.
    scale
        Metres in the skeleton's unit.
    names
        (E,) joints that carry the ellipsoids, several times the same.
    joint
        (E,) their indices.
    centre
        (E, 3) in the joint's frame, relative to the joint.
    shape
        (E, 3, 3) matrices B in the joint's frame.
    """

    skeleton: Skeleton
    scale: float
    names: tuple[str, ...]
    joint: Int[np.ndarray, " e"]
    centre: Float[np.ndarray, "e 3"]
    shape: Float[np.ndarray, "e 3 3"]


class Ellipsoids(NamedTuple):
    """Ellipsoids of F frames in metres: centre (F, E, 3) and shape B (F, E, 3, 3)."""

    centre: Float[np.ndarray, "f e 3"]
    shape: Float[np.ndarray, "f e 3 3"]


def body_of(skeleton: Skeleton) -> Body:
    """Dress a skeleton.

    Parameters
    ----------
    skeleton
        Any skeleton whose rest pose stands upright, y up.

    Raises
    ------
    InputError
        If its rest pose is flat: then its height, and so every thickness, is unknown.
    """
    rest = _rest(skeleton)
    height = float(np.ptp(rest[:, 1]))
    if height <= 0.3 * float(np.ptp(rest, axis=0).max()):
        raise InputError(
            f"skeleton {skeleton.name!r}",
            "its rest pose does not stand upright",
            "Use a skeleton whose joints with all angles zero stand, y up",
        )
    scale = skeleton.metres or STATURE / height
    stature = height * scale
    sideways = _sideways(rest)
    found: list[tuple[int, np.ndarray, np.ndarray]] = []
    for child in skeleton.joints[1:]:
        bone = np.array(child.offset) * scale
        part = _part(skeleton.joints[child.parent].name)
        length = float(np.linalg.norm(bone))
        if length < SHORTEST * stature or part.across == 0.0:
            continue
        axes = _frame(bone / length, sideways)
        half = np.array([length / 2 + part.beyond * stature, *_thickness(part, stature)])
        found.append((child.parent, bone / 2, axes @ np.diag(half**2) @ axes.T))
        if part.round:
            ball = (max(part.across, part.deep) * stature) ** 2 * np.eye(3)
            found.append((child.parent, np.zeros(3), ball))
    if not found:
        raise InputError(
            f"skeleton {skeleton.name!r}", "no bone has a length", "Use a skeleton of a body"
        )
    joint, centre, shape = (np.array(column) for column in zip(*found, strict=True))
    names = tuple(skeleton.names[j] for j in joint)
    return Body(skeleton, scale, names, joint, centre, shape)


def pose_body(body: Body, motion: xr.Dataset) -> Ellipsoids:
    """Give the ellipsoids of a body in every frame of one clip.

    Parameters
    ----------
    body
        From `body_of`, of a skeleton with the clip's degrees of freedom: another
        person's body can do the clip's motion.
    motion
        Motion of one clip.

    Raises
    ------
    InputError
        If the motion has several clips, only markers, or another skeleton's degrees of
        freedom.
    """
    clip = check_one_clip(motion)
    if "angle" not in motion or tuple(motion["dof"].values) != body.skeleton.dofs:
        raise InputError(
            f"clip {clip!r}",
            "its degrees of freedom are not those of the body",
            "Dress its own skeleton, or one with the same joints and channels",
        )
    own = skeleton_of(motion)
    # The root's path in metres; a body of another size takes its own steps' length.
    path = motion["root_position"].values * (own.metres or body.scale) / body.scale
    where, turned = poses(body.skeleton, motion["angle"].values, path)
    turned = turned[:, body.joint]
    centre = where[:, body.joint] * body.scale + np.einsum("feab,eb->fea", turned, body.centre)
    shape = turned @ body.shape @ turned.swapaxes(-1, -2)
    return Ellipsoids(centre, shape)


def _rest(skeleton: Skeleton) -> np.ndarray:
    """Give the positions of the joints with all angles zero."""
    where = np.zeros((len(skeleton), 3))
    for index, joint in enumerate(skeleton.joints[1:], start=1):
        where[index] = where[joint.parent] + joint.offset
    return where


def _sideways(rest: np.ndarray) -> np.ndarray:
    """Give the horizontal direction in which a standing body is widest: arm to arm."""
    flat = rest[:, [0, 2]] - rest[:, [0, 2]].mean(axis=0)
    x, z = np.linalg.svd(flat, full_matrices=False)[2][0]
    return np.array([x, 0.0, z])


def _part(name: str) -> Part:
    return next((part for part in PARTS if re.search(part.names, name, re.IGNORECASE)), OTHER)


def _thickness(part: Part, stature: float) -> tuple[float, float]:
    return part.across * stature, part.deep * stature


def _frame(along: np.ndarray, sideways: np.ndarray) -> np.ndarray:
    """Give axes (as columns) along a bone, to the side and to the front."""
    across = sideways - (sideways @ along) * along
    if np.linalg.norm(across) < 0.3:  # an arm held out to the side
        across = np.array([0.0, 1.0, 0.0]) - along[1] * along
    across = across / np.linalg.norm(across)
    return np.stack([along, across, np.cross(along, across)], axis=1)
