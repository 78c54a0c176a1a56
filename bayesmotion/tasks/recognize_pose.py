"""Poses from voxels, averaged over all draws of a fit."""

import json
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..catalogue import lacking
from ..fit import Fit
from ..inference.predicting import DRAWS, Prediction, predict
from ..models.voxel_pose.joint_angles import posed
from ..motion import Skeleton
from ..prediction import Mixture
from ..verbs import DecodesPoses
from .cautions import cautions, warn
from .outcome import made_by, table_of


@dataclass(frozen=True)
class RecognizedPoses:
    """Poses recognised in F frames.

    labels
        (A,) names of the angles.
    angles, sd
        (F, A) in radians, and their standard deviations: of the regression over all draws, and
        of what the principal components leave out.
    prediction
        Of the principal components.
    skeleton, rest
        What a pose is put on, and the angles in radians of degrees of freedom that are not
        recognised.
    frame_rate, clip
        Of the voxels.
    """

    labels: tuple[str, ...]
    angles: Float[np.ndarray, "f a"]
    sd: Float[np.ndarray, "f a"]
    prediction: Prediction
    skeleton: Skeleton
    rest: dict[str, float]
    frame_rate: float
    clip: str

    def to_dataset(self) -> xr.Dataset:
        """Return the angles with their uncertainty, frame by frame.

        Returns
        -------
        ``mean`` and ``sd`` (frame, channel) and ``quantiles`` (quantile, frame, channel) in
        radians, those of normal distributions; `bm.write` writes them as .nc or .csv.
        """
        return table_of(
            Mixture(self.angles[None], self.sd[None], np.ones(1)),
            self.labels,
            ["rad"] * len(self.labels),
            clip=self.clip,
            times=np.arange(len(self.angles)) / self.frame_rate,
            attrs=made_by(self.prediction),
        )

    def motion(self, root: Float[np.ndarray, "f 3"], *, frame_rate: float, clip: str) -> xr.Dataset:
        """Return the poses as a Motion.

        Parameters
        ----------
        root
            Positions of the root in the skeleton's unit, which voxels do not tell.
        frame_rate, clip
            Frames a second, and the clip's name.
        """
        return posed(
            self.angles, self.labels, self.skeleton, root, frame_rate=frame_rate, clip=clip,
            rest=self.rest,
        )  # fmt: skip


def recognize_pose(
    fit: Fit, voxels: xr.Dataset, *, draws: int = DRAWS, seed: int = 0
) -> RecognizedPoses:
    """Recognise the pose in every frame of voxels.

    Parameters
    ----------
    fit
        Of a `VoxelPose`, by any method.
    voxels
        As `sensing.voxels.carving.carve` gives them; poses that they have are not looked at.
    draws
        At most so many draws of the fit, evenly spread.
    seed
        Of random parts of the prediction.

    Raises
    ------
    InputError
        If it is no such fit, or there are no voxels.

    Warns
    -----
    MotionWarning
        If the fit's draws are not to be trusted, or the clip trained it.
    """
    model = fit.model
    if not isinstance(model, DecodesPoses):
        raise lacking(model.name, "it recognises no poses", DecodesPoses)
    found = predict(fit, voxels.drop_vars("angle", errors="ignore"), draws=draws, seed=seed)
    pose = found.site("pose")
    labels, angles, sd = model.joint_angles(fit.training, pose.means(), pose.sds() ** 2)
    skeleton = Skeleton.from_json(str(fit.motion.attrs["skeleton"]))
    rest = json.loads(str(fit.motion.attrs["rest"]))
    warn("the poses", cautions(fit, voxels))
    return RecognizedPoses(
        labels, angles, sd, found, skeleton, rest,
        float(voxels.attrs["frame_rate"]), str(voxels["clip"].values[0]),
    )  # fmt: skip
