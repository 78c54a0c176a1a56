"""Clips made whole: missing joints filled in, noise taken out.

What is NaN is missing, and so are joints that are named. Models of gait cycles answer for one
straight cycle of the clip, put on their one body (`tasks.gait`, `tasks.incomplete`); models of
motions for the clip as it is (`inference.predicting`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from ..catalogue import lacking
from ..errors import InputError
from ..fit import Fit
from ..inference.predicting import DRAWS, predict
from ..model import MotionData
from ..motion.features import check_one_clip
from ..motion.gait_skeleton import gait_skeleton, turning_joints, without_joints
from ..prediction import Mixture
from ..verbs import ConditionsOnCycles
from . import gait
from .incomplete import Incomplete, Score, incomplete_cycle, score


@dataclass(frozen=True)
class Reconstruction:
    """A clip made whole.

    motion
        What is seen of it (denoised: all of it), and the predicted mean for what is not.
    given
        The clip, or its gait cycle, with what was given of it; NaN where missing.
    mixture
        Predicted features (N, D), over draws of the fit.
    seen
        (N, D), which of them were given.
    score
        How far off joints of a gait cycle are that were named and recorded all the same; None
        where nothing is told of that.
    noise
        Standard deviation of the noise that was taken out, in that of the motion; None where
        none was.
    """

    motion: xr.Dataset
    given: xr.Dataset
    mixture: Mixture
    seen: Bool[np.ndarray, "n d"]
    score: Score | None = None
    noise: float | None = None

    @property
    def mean(self) -> Float[np.ndarray, "n d"]:
        """Predicted features."""
        return self.mixture.means()

    @property
    def sd(self) -> Float[np.ndarray, "n d"]:
        """Their standard deviations."""
        return self.mixture.sds()


def reconstruct(
    fit: Fit,
    clip: xr.Dataset,
    missing: Sequence[str] = (),
    *,
    cycle: int = 1,
    draws: int = DRAWS,
    seed: int = 0,
) -> Reconstruction:
    """Return a clip whose missing joints are filled in from the others.

    Parameters
    ----------
    fit
        A fit of a gait-pose model, or of a model of motions, by any method.
    clip
        Motion of one clip, NaN where angles are missing.
    missing
        Limbs (larm, rarm, lleg, rleg) or joints that are missing beside; what the clip holds
        for them is not looked at.
    cycle
        Which straight gait cycle of the clip is filled in, of a gait-pose model; from 1 on.
    draws
        At most so many draws of the fit, evenly spread.
    seed
        Of random parts.

    Raises
    ------
    InputError
        If nothing is missing, a name is no joint's, there is no such cycle, or the model does
        not predict motions.
    """
    if isinstance(fit.model, ConditionsOnCycles):
        found, trained = _cycle(fit, clip, missing, cycle, draws)
        encoding = trained.training.encoding
        u = encoding.scaled(found.motion)
        seen = np.isfinite(u)
        _require_missing(clip, seen)
        poses = gait.reconstruct(trained, u)
        told = score(trained, u, poses, encoding.scaled(found.truth), found.still)
        motion = encoding.motion(poses.means(), _name(found.motion, "reconstructed"))
        return Reconstruction(motion, found.motion, poses, seen, told)
    return _of_motions(fit, clip, missing, draws, seed)


def denoise(
    fit: Fit,
    clip: xr.Dataset,
    missing: Sequence[str] = (),
    *,
    noise: float | None = None,
    cycle: int = 1,
    draws: int = DRAWS,
) -> Reconstruction:
    """Return a gait cycle without its noise; what is missing is filled in.

    Parameters
    ----------
    fit
        A fit of a gait-pose model, by any method.
    clip, missing, cycle, draws
        As of `reconstruct`.
    noise
        Standard deviation of the noise in that of each feature along the cycle; None where it
        is not known, and estimated.

    Raises
    ------
    InputError
        If a name is no joint's, there is no such cycle, or the model is another.
    """
    if not isinstance(fit.model, ConditionsOnCycles):
        raise lacking(fit.model.name, "it takes no noise out of motions", ConditionsOnCycles)
    found, trained = _cycle(fit, clip, missing, cycle, draws)
    encoding = trained.training.encoding
    u = encoding.scaled(found.motion)
    poses, level = gait.denoise(trained, u, noise)
    motion = encoding.motion(poses.means(), _name(found.motion, "denoised"))
    return Reconstruction(motion, found.motion, poses, np.isfinite(u), None, level)


def _cycle(
    fit: Fit, clip: xr.Dataset, missing: Sequence[str], number: int, draws: int
) -> tuple[Incomplete, gait.Trained]:
    training = gait.cycles_of(fit)
    joints = gait.joints_named(training.encoding, missing)
    found = incomplete_cycle(clip, training.poses, number, joints)
    return found, gait.trained_of(fit, draws)


def _of_motions(
    fit: Fit, clip: xr.Dataset, missing: Sequence[str], draws: int, seed: int
) -> Reconstruction:
    name = check_one_clip(clip)
    if not isinstance(fit.training, MotionData):
        raise lacking(fit.model.name, "it does not predict motions", MotionData, ConditionsOnCycles)
    joints = [joint for one in missing for joint in gait.LIMBS.get(one, (one,))]
    known = turning_joints(gait_skeleton())
    for joint in joints:
        if joint not in known:
            names = ", ".join([*gait.LIMBS, *known])
            raise InputError(f"joint {joint!r}", "there is no such", f"Use some of {names}")
    given = without_joints(clip, joints)
    prediction = predict(fit, given, draws=draws, seed=seed)
    ((site, mixture),) = prediction.sites.items()
    assert isinstance(mixture, Mixture), "values of motions are normal"
    seen = np.isfinite(prediction.data.observed()[site].values)
    _require_missing(clip, seen)
    motion = prediction.motion({site: mixture.means()})
    motion = motion.assign_coords(clip=("frame", np.full(motion.sizes["frame"], name)))
    return Reconstruction(motion, given, mixture, seen)


def _require_missing(clip: xr.Dataset, seen: Bool[np.ndarray, "n d"]) -> None:
    if seen.all():
        name = str(clip["clip"].values[0])
        raise InputError(
            f"clip {name!r}", "nothing is missing in it", "Name joints or limbs as `missing`"
        )


def _name(cycle: xr.Dataset, what: str) -> str:
    return f"{cycle['clip'].values[0]} {what}"
