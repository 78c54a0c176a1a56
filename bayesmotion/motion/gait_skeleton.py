"""One body for everybody: 18 ball joints that walks of different people are put on.

The joints are those of Ding and Fan (2015): pelvis, three of the spine, neck, head,
and hip, knee, ankle, shoulder, elbow and wrist of either side. Lengths are those of an
adult of 1.75 m (`anthropometry`), in millimetres. The rest pose stands upright with
the arms held out to the sides.

A recorded pose, of a body of any convention (`joint_roles`), is put on it bone by bone: every
bone points where the recorded one does and keeps its twist from the rest pose, whichever
that is, so that nothing but the lengths (and what the clavicles and hips contribute) is lost.
Hands are held as at rest, where they go on from the forearms. What is missing (NaN)
of a recording takes with it all that hangs on it: which way a forearm points is not known
without the upper arm.
"""

from collections.abc import Collection

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from .dataset import skeleton_of
from .kinematics import poses, rest_places
from .roles import SIDES, ancestors, hips_and_waist, joint_roles, required_joints
from .skeleton import Joint, Skeleton
from .synthetic import anthropometry as body

STATURE = 1750.0
Sources = dict[str, tuple[str, str | None]]
NAME = "gait"
STILL = 1e-4  # radians that angles of a joint at rest differ by, at most
_SPINE = (body.SHOULDER_HEIGHT - body.CLAVICLE - body.ANKLE - body.SHANK - body.THIGH) / 3
_SPINE = _SPINE - body.PELVIS / 3
_NECK = body.CHIN_HEIGHT - body.SHOULDER_HEIGHT + body.CLAVICLE

# Joint, parent, offset in statures; of the limbs the left ones.
_MIDDLE = (
    ("lowerback", "root", (0.0, 0.0, 0.0)),
    ("upperback", "lowerback", (0.0, _SPINE, 0.0)),
    ("thorax", "upperback", (0.0, _SPINE, 0.0)),
    ("neck", "thorax", (0.0, _SPINE, 0.0)),
    ("head", "neck", (0.0, _NECK, 0.0)),
    ("head_end", "head", (0.0, 1.0 - body.CHIN_HEIGHT, 0.0)),
)
_LIMBS = (
    ("femur", "root", (body.HIP, -body.PELVIS, 0.0)),
    ("tibia", "femur", (0.0, -body.THIGH, 0.0)),
    ("foot", "tibia", (0.0, -body.SHANK, 0.0)),
    ("foot_end", "foot", (0.0, -body.ANKLE, body.BALL)),
    ("humerus", "thorax", (body.SHOULDER, _SPINE + body.CLAVICLE, 0.0)),
    ("radius", "humerus", (body.UPPER_ARM, 0.0, 0.0)),
    ("wrist", "radius", (body.FOREARM, 0.0, 0.0)),
    ("wrist_end", "wrist", (body.HAND, 0.0, 0.0)),
)

# Of every joint the role of the recorded joint that turns it, and of those that its bone may
# point to: the first other joint. The pelvis points nowhere, and the hands with the forearms.
_TRUNK_SOURCES = {
    "root": ("pelvis",),
    "lowerback": ("lower back", "upper back", "chest", "neck"),
    "upperback": ("upper back", "chest", "neck"),
    "thorax": ("chest", "neck"),
    "neck": ("neck", "head"),
    "head": ("head", "head top"),
}
_LIMB_SOURCES = {
    "femur": ("hip", "knee"),
    "tibia": ("knee", "ankle"),
    "foot": ("ankle", "toes"),
    "humerus": ("shoulder", "elbow"),
    "radius": ("elbow", "wrist"),
    "wrist": ("wrist",),
}
_SOURCES = _TRUNK_SOURCES | {
    f"{side[0]}{joint}": tuple(f"{side} {part}" for part in parts)
    for side in SIDES
    for joint, parts in _LIMB_SOURCES.items()
}
# Rest poses whose axes, or forearms, are off by less have the body's: people are not square.
SQUARE, STRAIGHT = np.deg2rad(30.0), np.deg2rad(10.0)


def gait_skeleton() -> Skeleton:
    """Give the body, in millimetres."""
    left = [(f"l{n}", p if p in ("root", "thorax") else f"l{p}", o) for n, p, o in _LIMBS]
    right = [
        (f"r{n[1:]}", p if p in ("root", "thorax") else f"r{p[1:]}", (-x, y, z))
        for n, p, (x, y, z) in left
    ]
    joints = [Joint("root", -1, (0.0, 0.0, 0.0), channels=("rz", "ry", "rx"))]
    places = {"root": 0}
    for name, parent, (x, y, z) in (*_MIDDLE, *left, *right):
        places[name] = len(joints)
        channels = () if name.endswith("_end") else ("rz", "ry", "rx")
        offset = (x * STATURE, y * STATURE, z * STATURE)
        joints.append(Joint(name, places[parent], offset, channels=channels))
    return Skeleton(NAME, tuple(joints), metres=0.001)


def turning_joints(skeleton: Skeleton) -> tuple[str, ...]:
    """Give the names of the joints that turn: 18 of the gait skeleton."""
    return tuple(joint.name for joint in skeleton if joint.channels)


def source_joints(skeleton: Skeleton) -> Sources:
    """Tell for every joint which joint of a recorded skeleton turns it, and where it points.

    Raises
    ------
    InputError
        If the skeleton lacks one.
    """
    needed = [roles[0] for roles in _SOURCES.values()]
    known = joint_roles(skeleton) | required_joints(skeleton, needed)
    sources = {}
    for joint, (role, *towards) in _SOURCES.items():
        turns = known[role]
        points = (known[other] for other in towards if known.get(other, turns) != turns)
        sources[joint] = (turns, next(points, None))
    # A neck of several joints bends in the middle: its first bone points to the second joint.
    turns, head = sources["neck"]
    if head is not None:
        line = ancestors(skeleton, skeleton.index(head))
        at = skeleton.index(turns)
        if at in line:
            sources["neck"] = (turns, skeleton.names[line[line.index(at) - 1]])
    return sources


def without_joints(motion: xr.Dataset, joints: Collection[str]) -> xr.Dataset:
    """Return a clip in which joints are missing: NaN at all angles of what turns them.

    Parameters
    ----------
    motion
        Motion of one clip, of any skeleton whose joints are known (`source_joints`).
    joints
        Names of joints of the gait skeleton.
    """
    dofs = [dof for joint in joints for dof in _recorded_dofs(motion, joint)]
    return motion.assign(angle=motion["angle"].where(~motion["dof"].isin(dofs)))


def still_joints(motion: xr.Dataset, joints: Collection[str]) -> tuple[str, ...]:
    """Return those of some joints that a recording holds at the same angles in all its frames.

    Nobody's joint does that over a whole stride: such values fill a place in a file.

    Parameters
    ----------
    motion
        Motion of one clip, of any skeleton whose joints are known (`source_joints`).
    joints
        Names of joints of the gait skeleton. Joints with missing values are not among those
        returned.
    """
    still = []
    for joint in joints:
        angle = motion["angle"].sel(dof=_recorded_dofs(motion, joint)).values
        if np.ptp(angle, axis=0).max(initial=0.0) < STILL:
            still.append(joint)
    return tuple(still)


def _recorded_dofs(motion: xr.Dataset, joint: str) -> list[str]:
    """Labels of the angles of the recorded joint that turns a joint of the gait skeleton."""
    skeleton = skeleton_of(motion)
    source, _ = source_joints(skeleton)[joint]
    return [f"{source}/{channel}" for channel in skeleton.joints[skeleton.index(source)].channels]


def limb_rotations(motion: xr.Dataset) -> Float[np.ndarray, "frame 18 3 3"]:
    """Give the world rotations of the 18 joints that put a clip on the gait skeleton.

    Parameters
    ----------
    motion
        Motion of one clip, of any skeleton whose joints are known (`source_joints`).

    Returns
    -------
    Rotations of every frame, y up (`upright`); NaN where an angle of the joint, or of one it hangs
    on, is missing.
    """
    skeleton, target = skeleton_of(motion), gait_skeleton()
    where, turned = poses(skeleton, motion["angle"].values, motion["root_position"].values)
    axes = _rest_axes(skeleton)
    columns = []
    sources = source_joints(skeleton)
    for name in turning_joints(target):
        turns, points = sources[name]
        rotation = turned[:, skeleton.index(turns)] @ axes
        if name.endswith("wrist"):
            rest = _rest_turn(target, name[0] + "radius", skeleton, sources, axes)
            straight = np.trace(rest) > 1.0 + 2.0 * np.cos(STRAIGHT)
            rotation = rotation if straight else rotation @ rest
        else:
            rotation = rotation @ _rest_turn(target, name, skeleton, sources, axes)
        if points is not None and _bends(skeleton, turns, points):
            along = where[:, skeleton.index(points)] - where[:, skeleton.index(turns)]
            rotation = _smallest_turn(rotation @ _bone(target, name), _unit(along)) @ rotation
        columns.append(rotation)
    return upright(skeleton, where) @ np.stack(columns, axis=1)


def upright(
    skeleton: Skeleton, where: Float[np.ndarray, "frame joint 3"]
) -> Float[np.ndarray, "3 3"]:
    """Give the turn of a recording's axes that makes y the vertical.

    The vertical is the axis that the trunk stands along, in the mean over frames. Recordings with
    y up are not turned, nor are those whose trunk is missing.
    """
    left, right, _ = hips_and_waist(skeleton)
    neck = skeleton.index(required_joints(skeleton, ["neck"])["neck"])
    trunk = where[:, neck] - 0.5 * (where[:, left] + where[:, right])
    trunk = trunk[np.isfinite(trunk).all(axis=1)]
    if not len(trunk):
        return np.eye(3)
    mean = trunk.mean(axis=0)
    vertical, y = np.zeros(3), np.array([0.0, 1.0, 0.0])
    along = int(np.abs(mean).argmax())
    vertical[along] = np.sign(mean[along])
    return np.diag([1.0, -1.0, -1.0]) if (vertical == -y).all() else _smallest_turn(vertical, y)


def _rest_axes(skeleton: Skeleton) -> Float[np.ndarray, "3 3"]:
    """Give the axes of the body at rest, as columns: to the left, up and to the front.

    They are told by the hips and the lowest joint of the spine. Most rest poses stand along axes
    of their file, and then these are meant.
    """
    rest = rest_places(skeleton)
    left, right, waist = (rest[index] for index in hips_and_waist(skeleton))
    across = _unit(left - right)
    up = waist - 0.5 * (left + right)
    up = _unit(up - (up @ across) * across)
    axes = np.stack([across, up, np.cross(across, up)], axis=1)
    square = np.round(axes)
    if not np.isclose(square.T @ square, np.eye(3)).all():
        return axes
    return square if Rotation.from_matrix(axes.T @ square).magnitude() < SQUARE else axes


def _rest_turn(
    target: Skeleton, name: str, skeleton: Skeleton, sources: Sources, axes: np.ndarray
) -> Float[np.ndarray, "3 3"]:
    """Give the smallest turn, in the body's axes, that takes its bone to the recorded at rest."""
    turns, points = sources[name]
    if points is None:
        return np.eye(3)
    recorded = _rest_way(skeleton, turns, points) @ axes
    # The BVH releases leave the thorax without a length: it points as the body's does.
    return _smallest_turn(_bone(target, name), recorded) if recorded.any() else np.eye(3)


def _bends(skeleton: Skeleton, start: str, end: str) -> bool:
    """Whether joints that turn lie between two joints."""
    line = ancestors(skeleton, skeleton.index(end))[1:]
    first = skeleton.index(start)
    return any(skeleton.joints[index].channels for index in line if index > first)


def _bone(skeleton: Skeleton, name: str) -> Float[np.ndarray, " 3"]:
    """Direction at rest from a joint to the first that hangs on it."""
    index = skeleton.index(name)
    child = next(joint for joint in skeleton if joint.parent == index)
    return _unit(np.array(child.offset))


def _rest_way(skeleton: Skeleton, start: str, end: str) -> Float[np.ndarray, " 3"]:
    """Direction at rest from a joint to one below it."""
    index, first = skeleton.index(end), skeleton.index(start)
    way = np.zeros(3)
    while index not in (first, -1):
        way = way + np.array(skeleton.joints[index].offset)
        index = skeleton.joints[index].parent
    return _unit(way)


def _smallest_turn(
    start: Float[np.ndarray, "*n 3"], end: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n 3 3"]:
    """Give the smallest turns that take unit vectors to others."""
    axis = np.cross(start, end)
    sine = _length(axis)
    cosine = np.vecdot(start, end)[..., None]
    angle = np.where(sine < 1e-9, 0.0, np.arctan2(sine, cosine))
    return Rotation.from_rotvec(axis / np.maximum(sine, 1e-9) * angle).as_matrix()


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.maximum(_length(vector), 1e-12)


def _length(vector: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 1"]:
    return np.sqrt(np.vecdot(vector, vector))[..., None]
