"""The energy flow of a clip in the global and in the body's frame."""

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...motion.dataset import skeleton_of
from ...motion.kinematics import positions
from ...motion.roles import hips_and_waist
from .energy import body_centred, energy


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
        hips_and_waist(skeleton_of(motion)),
        weight=weight,
        smoothing=smoothing,
    )
