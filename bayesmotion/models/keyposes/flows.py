"""The energy flow of a clip in the global and in the body's frame."""

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...errors import InputError
from ...motion.dataset import skeleton_of
from ...motion.kinematics import positions
from ...motion.skeleton import Skeleton
from .energy import body_centred, energy

# Hips and a point of the spine, by the names skeletons give them.
HIPS = (("lfemur", "rfemur"), ("LeftUpLeg", "RightUpLeg"), ("LHip", "RHip"))
WAISTS = ("lowerback", "upperback", "Spine1", "Spine", "thorax")


def flows(
    position: Float[np.ndarray, "n j 3"],
    frame_rate: float,
    frame: tuple[int, int, int],
    *,
    weight: Float[np.ndarray, " j"] | None = None,
    smoothing: float = 0.08,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return the energy flow in the global and in the body's frame.

    Parameters
    ----------
    position
        Markers or joints in the global frame.
    frame_rate
        Frames a second.
    frame
        Columns of the left hip, the right hip and the waist.
    weight, smoothing
        As for `bayesmotion.models.keyposes.energy.energy`.
    """
    seen = (position, body_centred(position, *frame))
    flow = [energy(part, frame_rate, weight=weight, smoothing=smoothing) for part in seen]
    return flow[0], flow[1]


def flows_of(
    motion: xr.Dataset,
    weight: Float[np.ndarray, " j"] | None = None,
    smoothing: float = 0.08,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return the energy flow of one clip in the global and in the body's frame."""
    return flows(
        positions(motion).values,
        float(motion.attrs["frame_rate"]),
        body_frame(motion),
        weight=weight,
        smoothing=smoothing,
    )


def body_frame(motion: xr.Dataset) -> tuple[int, int, int]:
    """Return the left hip, the right hip and the waist among a skeleton's joints.

    Raises
    ------
    InputError
        If the skeleton names them otherwise.
    """
    skeleton = skeleton_of(motion)
    for left, right in HIPS:
        for waist in WAISTS:
            if {left, right, waist} <= set(skeleton.names):
                above = _above(skeleton, waist)
                return skeleton.index(left), skeleton.index(right), skeleton.index(above)
    raise InputError(
        f"skeleton {skeleton.name!r}",
        "its hips and spine have other names than are known",
        f"Name joints {HIPS[0][0]}, {HIPS[0][1]} and {WAISTS[0]}, or use the functions of "
        "bayesmotion.models.keyposes",
    )


def _above(skeleton: Skeleton, waist: str) -> str:
    """Return the first joint up the spine that does not sit between the hips."""
    index = skeleton.index(waist)
    for joint in skeleton.joints[index:]:
        spine = joint.parent == index or joint.name == waist
        if spine and any(joint.offset):
            return joint.name
    return waist
