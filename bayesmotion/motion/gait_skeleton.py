"""One body for everybody: 18 ball joints that walks of different people are put on.

The joints are those of Ding and Fan (2015): pelvis, three of the spine, neck, head,
and hip, knee, ankle, shoulder, elbow and wrist of either side. Lengths are those of an
adult of 1.75 m (`anthropometry`), in millimetres. The rest pose stands upright with
the arms held out to the sides.

A recorded pose is put on it bone by bone: every bone points where the recorded one
does and keeps its twist, so that nothing but the lengths (and what the clavicles and
hips contribute) is lost. What is missing (NaN) of a recording takes with it all that
hangs on it: which way a forearm points is not known without the upper arm.
"""

from collections.abc import Collection

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..errors import InputError
from .dataset import skeleton_of
from .kinematics import poses
from .skeleton import Joint, Skeleton
from .synthetic import anthropometry as body

STATURE = 1750.0
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

# Of every joint: which recorded joint turns it, and towards which its bone points, by
# the names of CMU's ASF and of the BVH releases. The pelvis points nowhere.
_SIDES = {"l": ("l", "Left"), "r": ("r", "Right")}
_SPINE_SOURCES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "root": (("root", "Hips"), ()),
    "lowerback": (("lowerback", "LowerBack"), ("upperback", "Spine", "Chest")),
    "upperback": (("upperback", "Spine", "Chest"), ("thorax", "Spine1", "Chest2")),
    "thorax": (("thorax", "Spine1", "Chest2"), ("lowerneck", "Neck")),
    "neck": (("lowerneck", "Neck"), ("upperneck", "Neck1", "Neck")),
    "head": (("head", "Head"), ("head_end", "Head_end")),
}
_LIMB_SOURCES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "femur": (("{}femur", "{}UpLeg", "{}Hip"), ("{}tibia", "{}Leg", "{}Knee")),
    "tibia": (("{}tibia", "{}Leg", "{}Knee"), ("{}foot", "{}Foot", "{}Ankle")),
    "foot": (("{}foot", "{}Foot", "{}Ankle"), ("{}toes", "{}ToeBase", "{}Toe")),
    "humerus": (("{}humerus", "{}Arm", "{}Shoulder"), ("{}radius", "{}ForeArm", "{}Elbow")),
    "radius": (("{}radius", "{}ForeArm", "{}Elbow"), ("{}wrist", "{}Hand", "{}Wrist")),
    "wrist": (("{}wrist", "{}Hand", "{}Wrist"), ()),
}


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


def source_joints(skeleton: Skeleton) -> dict[str, tuple[str, str | None]]:
    """Tell for every joint which joint of a recorded skeleton turns it, and where it points.

    Raises
    ------
    InputError
        If the skeleton lacks one.
    """
    wanted = dict(_SPINE_SOURCES)
    for side, sides in _SIDES.items():
        for joint, (turns, points) in _LIMB_SOURCES.items():
            wanted[f"{side}{joint}"] = (_sided(turns, sides), _sided(points, sides))
    own = set(skeleton.names)
    return {
        joint: (_first(skeleton, own, turns), _first(skeleton, own, points) if points else None)
        for joint, (turns, points) in wanted.items()
    }


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


def _sided(names: tuple[str, ...], sides: tuple[str, str]) -> tuple[str, ...]:
    """Give names of one side: the first is the ASF name, the others those of BVH files."""
    return tuple(name.format(sides[min(place, 1)]) for place, name in enumerate(names))


def _first(skeleton: Skeleton, own: set[str], names: tuple[str, ...]) -> str:
    for name in names:
        if name in own:
            return name
    raise InputError(
        f"skeleton {skeleton.name!r}",
        f"it has no joint {' or '.join(names)}",
        "Give a recording with the joint names of CMU or of its BVH releases",
    )


def limb_rotations(motion: xr.Dataset) -> Float[np.ndarray, "frame 18 3 3"]:
    """Give the world rotations of the 18 joints that put a clip on the gait skeleton.

    Parameters
    ----------
    motion
        Motion of one clip, of any skeleton whose joints are known (`source_joints`).

    Returns
    -------
    Rotations of every frame; NaN where an angle of the joint, or of one it hangs on, is missing.
    """
    skeleton, target = skeleton_of(motion), gait_skeleton()
    _, turned = poses(skeleton, motion["angle"].values, motion["root_position"].values)
    columns = []
    sources = source_joints(skeleton)
    for name in turning_joints(target):
        turns, points = sources[name]
        rotation = turned[:, skeleton.index(turns)]
        columns.append(rotation @ _to_rest(target, name, skeleton, turns, points))
    return np.stack(columns, axis=1)


def _to_rest(
    target: Skeleton, name: str, skeleton: Skeleton, turns: str, points: str | None
) -> Float[np.ndarray, "3 3"]:
    """Give the smallest turn that takes a bone of the body to the recorded bone at rest."""
    if points is None:
        return np.eye(3)
    own = _bone(target, name)
    recorded = _rest_way(skeleton, turns, points)
    # The BVH releases leave the thorax without a length: it points as the body's does.
    if not recorded.any():
        return np.eye(3)
    axis = np.cross(own, recorded)
    sine, cosine = np.linalg.norm(axis), own @ recorded
    if sine < 1e-9:
        return np.eye(3)
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)).as_matrix()


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


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)
