"""Joint angles of poses, from a Motion and back, and how far they are off (Sun et al. 2006).

The paper's 14 joints are the torso's centre, neck, shoulders, elbows, wrists, hips, knees
and ankles, each with three angles: 42. The torso's are the root's heading, pitch and roll,
whose order unlike others has no singularity for anybody who stands. The other joints' are
the angles about z, y and x that turn them from the rest pose in the axes of their parents,

    R_parent^T R_joint = Rz Ry Rx,    -90 <= y <= 90 degrees,

as BVH files have them, and as `write_bvh` writes them; the axes that an ASF file gives to
single bones, about which a knee has one angle, do not matter.
"""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...errors import InputError
from ...motion import Joint, Skeleton, make_motion, skeleton_of
from ...motion.euler import continuous_angles, euler_angles, joint_rotation

# The paper's joints beside the root, by their names in CMU and HDM05.
LIMBS = ("humerus", "radius", "wrist", "femur", "tibia", "foot")
PAPER_JOINTS = ("lowerneck", *(side + limb for limb in LIMBS for side in "lr"))
TORSO = ("heading", "pitch", "roll")
_TORSO_ORDER, _LIMB_ORDER = "YXZ", "ZYX"


def angle_labels(skeleton: Skeleton) -> tuple[str, ...]:
    """Name the angles of a pose: three of each of the paper's joints, or of all if it lacks one.

    Raises
    ------
    InputError
        If the root does not turn about three axes.
    """
    root = skeleton.joints[0]
    if len(root.channels) != 3:
        raise InputError(
            f"skeleton {skeleton.name!r}",
            "its root does not turn about three axes",
            "Use a skeleton whose root has the channels rx, ry and rz",
        )
    has = set(PAPER_JOINTS) <= set(skeleton.names)
    chosen = [j.name for j in skeleton.joints[1:] if j.channels]
    if has:
        chosen = [name for name in chosen if name in PAPER_JOINTS]
    limbs = [f"{name}/{axis}" for name in chosen for axis in "zyx"]
    return (*(f"{root.name}/{part}" for part in TORSO), *limbs)


def angles_of(motion: xr.Dataset, labels: Sequence[str]) -> Float[np.ndarray, "frame angle"]:
    """Return the angles of one skeleton's poses in radians.

    Raises
    ------
    InputError
        If the skeleton lacks one of them.
    """
    skeleton = skeleton_of(motion)
    joints = _joints(labels)
    lacking = sorted(set(joints) - set(skeleton.names))
    if lacking:
        raise InputError(
            f"skeleton {skeleton.name!r}",
            f"it has no angle of {', '.join(lacking)}",
            "Use clips whose skeletons name their joints alike",
        )
    turned = Rotation.from_euler(_order(skeleton), motion["angle"].sel(dof=_root(skeleton)).values)
    columns = [continuous_angles(turned, _TORSO_ORDER)]
    for name in joints:
        joint = skeleton.joints[skeleton.index(name)]
        values = motion["angle"].sel(dof=_dofs(joint)).values
        columns.append(euler_angles(joint_rotation(joint, values), _LIMB_ORDER))
    return np.column_stack(columns)


def mirrored(
    angles: Float[np.ndarray, "frame a"], labels: Sequence[str]
) -> Float[np.ndarray, "frame a"]:
    """Return the angles of poses as a mirror shows them that swaps left and right (x and -x).

    Joints whose names begin with l or r swap with each other if both are there.
    """
    swap = {"l": "r", "r": "l"}
    names = set(labels)
    other = [swap.get(label[0], label[0]) + label[1:] for label in labels]
    order = [
        labels.index(twin if twin in names else label)
        for label, twin in zip(labels, other, strict=True)
    ]
    # A mirror across x keeps turns about x and turns those about y and z around.
    keeps = [label.split("/")[1] in ("x", "pitch") for label in labels]
    return angles[:, order] * np.where(keeps, 1.0, -1.0)


def wrapped(difference: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Bring differences of angles to where they are smallest: -pi to pi."""
    return (difference + np.pi) % (2.0 * np.pi) - np.pi


def rms_degrees(
    true: Float[np.ndarray, "frame angle"], found: Float[np.ndarray, "frame angle"]
) -> float:
    """Root mean squared error over the frames, in degrees, averaged over the angles."""
    return float(np.degrees(np.sqrt((wrapped(found - true) ** 2).mean(axis=0)).mean()))


def absolute_degrees(
    true: Float[np.ndarray, "frame angle"], found: Float[np.ndarray, "frame angle"]
) -> float:
    """Mean absolute error over frames and angles, in degrees (eq. 6)."""
    return float(np.degrees(np.abs(wrapped(found - true)).mean()))


def turned_degrees(
    true: Float[np.ndarray, "frame angle"], found: Float[np.ndarray, "frame angle"]
) -> float:
    """Root mean square over the frames of how far joints are turned off, averaged over joints.

    In degrees; three angles a joint, the torso's first. It knows no axes and no singularities.
    """
    errors = []
    for start in range(0, true.shape[1], 3):
        order = _LIMB_ORDER if start else _TORSO_ORDER
        one, other = (
            Rotation.from_euler(order, angles[:, start : start + 3]) for angles in (true, found)
        )
        errors.append(np.sqrt(((one.inv() * other).magnitude() ** 2).mean()))
    return float(np.degrees(np.mean(errors)))


def posed(
    angles: Float[np.ndarray, "frame a"],
    labels: Sequence[str],
    skeleton: Skeleton,
    root: Float[np.ndarray, "frame 3"],
    *,
    frame_rate: float,
    clip: str,
    rest: dict[str, float],
) -> xr.Dataset:
    """Make the Motion of angles.

    Parameters
    ----------
    angles, labels
        As `angles_of` gives them.
    skeleton
        With these angles.
    root
        Positions of the root in the skeleton's unit.
    frame_rate, clip
        As for `make_motion`.
    rest
        Angles in radians of the degrees of freedom not among the labels; zero if not there.
    """
    columns = {dof: np.full(len(angles), rest.get(dof, 0.0)) for dof in skeleton.dofs}
    turned = Rotation.from_euler(_TORSO_ORDER, angles[:, :3])
    triple = continuous_angles(turned, _order(skeleton))
    columns |= dict(zip(_root(skeleton), triple.T, strict=True))
    for place, name in enumerate(_joints(labels), start=1):
        joint = skeleton.joints[skeleton.index(name)]
        turn = Rotation.from_euler(_LIMB_ORDER, angles[:, 3 * place : 3 * place + 3])
        columns |= dict(zip(_dofs(joint), _channels(joint, turn).T, strict=True))
    angle = np.stack([columns[dof] for dof in skeleton.dofs], axis=1)
    return make_motion(skeleton, angle, root, frame_rate=frame_rate, clip=clip)


def _channels(joint: Joint, turn: Rotation) -> Float[np.ndarray, "frame channel"]:
    """Return the angles of a joint's channels; those it lacks are left out of the rotation."""
    frame = Rotation.from_euler("ZYX", joint.axis[::-1])
    own = [channel[1].upper() for channel in joint.channels]
    order = "".join([*own, *(axis for axis in "ZYX" if axis not in own)])
    return continuous_angles(frame.inv() * turn * frame, order)[:, : len(own)]


def _joints(labels: Sequence[str]) -> list[str]:
    """Name the joints after the root, in the order of their angles."""
    return list(dict.fromkeys(label.split("/")[0] for label in labels[3:]))


def _dofs(joint: Joint) -> list[str]:
    return [f"{joint.name}/{channel}" for channel in joint.channels]


def _root(skeleton: Skeleton) -> list[str]:
    return _dofs(skeleton.joints[0])


def _order(skeleton: Skeleton) -> str:
    return "".join(channel[1].upper() for channel in skeleton.joints[0].channels)
