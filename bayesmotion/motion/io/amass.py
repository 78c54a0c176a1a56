"""Rotations of the joints of SMPL bodies, as AMASS stores them in .npz files.

The body model, which gives a person's bones and surface from `betas`, is not used: the
rotations are exact, and the bones are those of an average adult.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...errors import InputError
from ...npz import read_arrays
from ..dataset import add_history, make_motion
from ..euler import continuous_angles
from ..skeleton import Joint, Skeleton
from ..synthetic import anthropometry as adult
from .rates import declared_rate, nominal

STATURE = 1.7  # metres
_RATES = ("mocap_framerate", "mocap_frame_rate")
_THIRD = adult.HAND / 6  # of a finger
MEND = "Give one of AMASS"

# Joint, parent, offset in statures; y up, x to the left, the arms held out. One side only.
_PELVIS_UP = adult.SHOULDER_HEIGHT - adult.ANKLE - adult.SHANK - adult.THIGH - adult.PELVIS
_TRUNK = (
    ("spine1", "pelvis", (0.0, _PELVIS_UP / 4, 0.0)),
    ("spine2", "spine1", (0.0, _PELVIS_UP / 4, 0.0)),
    ("spine3", "spine2", (0.0, _PELVIS_UP / 4, 0.0)),
    ("neck", "spine3", (0.0, _PELVIS_UP / 4, 0.0)),
    ("head", "neck", (0.0, adult.CHIN_HEIGHT - adult.SHOULDER_HEIGHT, 0.0)),
    ("jaw", "head", (0.0, 0.0, 0.0)),
    ("left_eye_smplhf", "head", (0.0, 0.0, 0.0)),
    ("right_eye_smplhf", "head", (0.0, 0.0, 0.0)),
)
_LIMBS = (
    ("hip", "pelvis", (adult.HIP, -adult.PELVIS, 0.0)),
    ("knee", "hip", (0.0, -adult.THIGH, 0.0)),
    ("ankle", "knee", (0.0, -adult.SHANK, 0.0)),
    ("foot", "ankle", (0.0, -adult.ANKLE, adult.BALL)),
    ("collar", "spine3", (0.02, _PELVIS_UP / 4 - adult.CLAVICLE, 0.0)),
    ("shoulder", "collar", (adult.SHOULDER - 0.02, adult.CLAVICLE, 0.0)),
    ("elbow", "shoulder", (adult.UPPER_ARM, 0.0, 0.0)),
    ("wrist", "elbow", (adult.FOREARM, 0.0, 0.0)),
    ("hand", "wrist", (adult.HAND / 2, 0.0, 0.0)),
)
_FINGERS = {"index": 0.02, "middle": 0.0, "pinky": -0.04, "ring": -0.02, "thumb": 0.03}
_HANDS = tuple(
    f"{side}_{finger}{part}"
    for side in ("left", "right")
    for finger in _FINGERS
    for part in (1, 2, 3)
)
_BODY = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2",
    "left_ankle", "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar",
    "right_collar", "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist",
)  # fmt: skip
# The joints in the order of `poses`, by how many there are: the body, SMPL, SMPL-H, SMPL-X.
_ORDERS = {
    len(order): order
    for order in (
        _BODY,
        (*_BODY, "left_hand", "right_hand"),
        (*_BODY, *_HANDS),
        (*_BODY, "jaw", "left_eye_smplhf", "right_eye_smplhf", *_HANDS),
    )
}


def read_amass(
    path: str | Path,
    *,
    frame_rate: float | None = None,
    clip: str | None = None,
    labels: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Read the joint rotations of an AMASS file.

    Parameters
    ----------
    path
        The .npz file, with ``poses`` (frame, 3 x joints), rotation vectors of the 22 joints of
        the body, of SMPL (24), SMPL-H (52) or SMPL-X (55), and ``trans`` (frame, 3) in metres.
    frame_rate
        Frames a second, where the file does not say (``mocap_framerate``).
    clip
        Name of the clip, by default the file's stem.
    labels
        What is known of the clip, for example its subject.

    Returns
    -------
    Motion of one clip in radians and metres, on the bones of an average adult of 1.7 m. The
    axes are the file's: in AMASS, z is up.

    Raises
    ------
    InputError
        If the file is missing, no .npz, or has no such arrays.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> motion = bm.read("walk_poses.npz")  # doctest: +SKIP
    """
    path = Path(path)
    arrays = _arrays(path, ("poses", "trans", *_RATES))
    poses = arrays.get("poses", np.zeros(0))
    order = _ORDERS.get(poses.shape[1] // 3) if poses.ndim == 2 else None
    if order is None or poses.shape[1] % 3 or not len(poses):
        counts = ", ".join(str(3 * count) for count in _ORDERS)
        raise InputError(
            path, f"its poses have the shape {poses.shape}", f"Give poses (frame, {counts})"
        )
    if not np.isfinite(poses).all():
        frame = np.argwhere(~np.isfinite(poses))[0][0]
        raise InputError(f"{path}, frame {frame}", "a pose is not finite", "Leave the frame out")
    skeleton = _skeleton(order)
    if frame_rate is None:
        rate = next((arrays[name] for name in _RATES if name in arrays), np.zeros(1))
        told = float(rate.ravel()[0])
        frame_rate = nominal(declared_rate(path, told, f"{_RATES[0]} {told:g}"))
    vectors = dict(zip(order, np.moveaxis(poses.reshape(len(poses), -1, 3), 1, 0), strict=True))
    motion = make_motion(
        skeleton,
        np.hstack([_angles(joint, vectors[joint.name]) for joint in skeleton]),
        arrays.get("trans", np.zeros((len(poses), 3))),
        frame_rate=frame_rate,
        clip=path.stem if clip is None else clip,
        labels=labels,
        source=path.name,
    )
    return add_history(motion, f"read_amass: bones of an average adult of {STATURE} m")


def _arrays(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Read arrays of numbers from an .npz file, those of the names that are there."""
    found = read_arrays(path, "AMASS", MEND, names=names)
    for name, values in found.items():
        if values.dtype.kind not in "iuf":
            raise InputError(path, f"its {name} are no numbers", MEND)
    return {name: values.astype(np.float64) for name, values in found.items()}


def _angles(joint: Joint, vectors: Float[np.ndarray, "frame 3"]) -> Float[np.ndarray, "frame 3"]:
    """Turn rotation vectors into the angles of a joint's channels."""
    order = "".join(channel[1] for channel in joint.channels).upper()
    return continuous_angles(Rotation.from_rotvec(vectors), order)


def _skeleton(order: tuple[str, ...]) -> Skeleton:
    """Make the skeleton of an average adult with these joints, parents first."""
    bones = {"pelvis": ("", (0.0, 0.0, 0.0)), **{name: (up, at) for name, up, at in _TRUNK}}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for name, parent, (x, y, z) in _LIMBS:
            up = parent if parent in bones else f"{side}_{parent}"
            bones[f"{side}_{name}"] = (up, (sign * x, y, z))
        for finger, ahead in _FINGERS.items():
            for part in (1, 2, 3):
                up = f"{side}_{finger}{part - 1}" if part > 1 else f"{side}_wrist"
                along = _THIRD if part > 1 else adult.HAND / (4 if finger == "thumb" else 2)
                bones[f"{side}_{finger}{part}"] = (up, (sign * along, 0.0, (part == 1) * ahead))
    joints = []
    for name in order:
        up, (x, y, z) = bones[name]
        offset = (x * STATURE, y * STATURE, z * STATURE)
        joints.append(Joint(name, order.index(up) if up else -1, offset, channels=_turns(name)))
    return Skeleton(f"smpl{len(order)}", tuple(joints), metres=1.0)


def _turns(name: str) -> tuple[str, ...]:
    """Choose the order of the angles: the middle one is what a joint turns about the least.

    Arms lie along x in the rest pose, legs and trunk along y.
    """
    arm = any(part in name for part in ("collar", "shoulder", "elbow", "wrist", "hand"))
    return ("ry", "rx", "rz") if arm or name in _HANDS else ("rz", "ry", "rx")
