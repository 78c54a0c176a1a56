"""From a segment's vector back to a motion: a person doing a task never recorded of them.

The motion tensor predicts the vector of a cell nobody recorded from the effects of its
levels. Its cosine coefficients give the matrices of the joints' rotations over time, which
are brought to the nearest rotations and written as the skeleton's own angles. Few
coefficients make a smooth motion: for this purpose fit the tensor with more of them.

A vector holds poses seen from the root: where the root goes is not in it. It stays in
place, and at every moment the lowest joint stands on the floor.
"""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..catalogue import lacking
from ..errors import InputError
from ..fit import Fit
from ..inference.draws import stacked
from ..motion.dataset import make_motion
from ..motion.euler import continuous_angles
from ..motion.kinematics import poses
from ..motion.segments import from_cosine
from ..motion.skeleton import Joint, Skeleton
from ..verbs import PredictsCells
from .recognize import LabelledSegments

DRAWS = 100
ENTRIES = [row + column for row in "xyz" for column in "xyz"]


@runtime_checkable
class PlacedSegments(LabelledSegments, Protocol):
    """Training data of labelled segments on one body."""

    @property
    def body(self) -> Skeleton:
        """The skeleton that all were put on."""
        ...


def cell_segment(fit: Fit, levels: Mapping[str, str], draws: int = DRAWS) -> xr.DataArray:
    """Return the mean vector of a combination of known levels, recorded or not.

    Parameters
    ----------
    fit
        Of the motion tensor.
    levels
        A level of every mode.
    draws
        At most so many draws of the fit, evenly spread, whose means are averaged.

    Returns
    -------
    Array (channel, coefficient) as `bayesmotion.motion.segments.segments` makes them.

    Raises
    ------
    InputError
        If a mode has no level, or one that is not known, or the fit is of another model.
    """
    model = fit.model
    if not isinstance(model, PredictsCells):
        raise lacking(model.name, "it makes no segments", PredictsCells)
    return model.cell(fit.training, levels, stacked(fit, draws)[0])


def synthesise_cell(
    fit: Fit, levels: Mapping[str, str], seconds: float | None = None, draws: int = DRAWS
) -> xr.Dataset:
    """Make the motion of a combination of levels by a fit of the motion tensor.

    Parameters
    ----------
    fit
        Of the tensor, with rotations among its channels and with the mean pose.
    levels
        A level of every mode.
    seconds
        Length; by default that of the training segments of the last mode's level on average.
    draws
        As for `cell_segment`.

    Raises
    ------
    InputError
        If a level is not known, or the vectors hold no rotations.
    """
    segment = cell_segment(fit, levels, draws)
    rate = fit.frame_rate
    training = fit.training
    assert isinstance(training, PlacedSegments), "a model of cells has segments on a body"
    known, mode = training.segments, list(training.levels)[-1]
    if seconds is None:
        seconds = float(known["seconds"].values[known[mode].values == levels[mode]].mean())
    return segment_motion(segment, training.body, max(2, round(seconds * rate)), rate, dict(levels))


def segment_motion(
    segment: xr.DataArray, skeleton: Skeleton, frames: int, rate: float, labels: dict[str, str]
) -> xr.Dataset:
    """Make the motion that a segment's rotations describe.

    Parameters
    ----------
    segment
        (channel, coefficient), with the rotations of joints and coefficient 0.
    skeleton
        The body.
    frames, rate
        Length of the motion, and frames a second.
    labels
        Of the clip, whose name they make.
    """
    names = segment["channel"].values.tolist()
    if "root" not in {name.split("/")[0] for name in names if name[-2:] in ENTRIES} or (
        segment["coefficient"].values[0] != 0
    ):
        raise InputError(
            "segments", "they do not hold all rotations",
            "Fit the tensor with channels rotations or both, and with the mean pose",
        )  # fmt: skip
    track = from_cosine(segment.values.T, frames)
    angle = np.zeros((frames, len(skeleton.dofs)))
    for joint in skeleton:
        entries = [f"{joint.name}/{entry}" for entry in ENTRIES]
        if not joint.channels or entries[0] not in names:
            continue
        matrices = track[:, [names.index(entry) for entry in entries]].reshape(-1, 3, 3)
        columns = [skeleton.dofs.index(f"{joint.name}/{channel}") for channel in joint.channels]
        angle[:, columns] = joint_angles(joint, matrices)
    still = np.zeros((frames, 3))
    still[:, 1] = -poses(skeleton, angle, still)[0][..., 1].min(axis=1)
    return make_motion(
        skeleton,
        angle,
        still,
        frame_rate=rate,
        clip="-".join(labels.values()),
        labels=labels,
        source="made by the motion tensor",
    )


def joint_angles(joint: Joint, matrices: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n c"]:
    """Give the angles of a joint's channels that come nearest to matrices C E C^T.

    With three channels every rotation is met; with fewer the angles of the other axes are
    left out.
    """
    left, _, right = np.linalg.svd(matrices)
    sign = np.linalg.det(left @ right)
    left[:, :, 2] *= sign[:, None]
    frame = Rotation.from_euler("ZYX", joint.axis[::-1])
    turn = frame.inv() * Rotation.from_matrix(left @ right) * frame
    own = "".join(channel[1].upper() for channel in joint.channels)
    order = own + "".join(axis for axis in "ZYX" if axis not in own)
    return continuous_angles(turn, order)[:, : len(own)]
