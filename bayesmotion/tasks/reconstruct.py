"""Clips made whole by a fit: missing joints filled in, noise taken out of gait cycles.

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
from ..inference.predicting import DRAWS, Prediction, predict
from ..model import MotionData
from ..models.gait_pose.encoding import CycleEncoding
from ..motion.dataset import skeleton_of
from ..motion.features import check_one_clip
from ..motion.gait_skeleton import gait_skeleton, turning_joints, without_joints
from ..motion.resampling import at_rate
from ..motion.roles import joint_roles
from ..prediction import Mixture
from ..verbs import ConditionsOnCycles
from . import gait
from .cautions import cautions, warn
from .incomplete import Incomplete, Score, incomplete_cycle, score
from .outcome import Channels, OfMixture, channels_of, chosen_samples, made_by, one_clip


@dataclass(frozen=True, repr=False)
class Reconstruction(OfMixture):
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
    channels
        How the features are told of.
    samples
        Joint draws of all features (J, N, D) and their weights; None where the model tells
        features frame by frame only.
    messages
        What is not to be believed of it, in sentences.
    features
        (N, D) what was given of the features; NaN where missing.
    """

    motion: xr.Dataset
    given: xr.Dataset
    mixture: Mixture
    seen: Bool[np.ndarray, "n d"]
    score: Score | None = None
    noise: float | None = None
    channels: Channels | None = None
    samples: Prediction | None = None
    messages: tuple[str, ...] = ()
    features: Float[np.ndarray, "n d"] | None = None

    def __repr__(self) -> str:
        """Return what was made whole, and what is not to be believed of it."""
        frames, share = self.motion.sizes["frame"], 1.0 - float(self.seen.mean())
        told = f"Reconstruction of {one_clip(self.motion)!r}: {frames} frames, {share:.0%} missing"
        if self.noise is not None:
            told += f", noise of {self.noise:.1%} of the motion taken out"
        return "\n".join([told, *(f"  warning: {text}" for text in self.messages)])

    def draws(self, count: int = 10, seed: int = 0) -> list[xr.Dataset]:
        """Return draws of the whole clip as motions, all of them different.

        Parameters
        ----------
        count
            At most so many: there are `samples` of `reconstruct` of every component.
        seed
            Of the choice among them, by the weights of their components.

        Raises
        ------
        InputError
            If the model tells cycles pose by pose: drawn so, they would tremble.
        """
        if self.samples is None:
            raise InputError(
                "draws", "a gait-pose model tells the poses of a cycle one by one",
                "Take means and quantiles (to_dataset), or a fit of multifactor",
            )  # fmt: skip
        (site,), chosen = self.samples.sites, chosen_samples(self.samples, count, seed)
        return [self.samples.motion({site: y}) for y in chosen]

    def to_dataset(self) -> xr.Dataset:
        """Return every frame of the clip; what was given of it has no uncertainty.

        Returns
        -------
        ``mean``, ``sd`` and ``given`` (frame, channel) and ``quantiles`` (quantile, frame,
        channel) of the features in their own units and of anatomical angles in degrees
        (`tasks.outcome`); `bm.write` writes them as .nc or .csv.
        """
        assert self.channels is not None, "made by reconstruct() or denoise_cycle()"
        attrs = {} if self.samples is None else made_by(self.samples)
        given = None
        if self.noise is None and self.features is not None:
            given = (self.features, self.seen)
        name = one_clip(self.motion)
        return self.channels.table(self.mixture, self.motion, name, attrs, given=given)


def reconstruct(
    fit: Fit,
    clip: xr.Dataset,
    missing: Sequence[str] = (),
    *,
    cycle: int = 1,
    draws: int = DRAWS,
    samples: int = 1,
    seed: int = 0,
) -> Reconstruction:
    """Return a clip whose missing joints are filled in from the others.

    Parameters
    ----------
    fit
        A fit of a gait-pose model, or of a model of motions, by any method.
    clip
        Motion of one clip, NaN where angles are missing. One of another frame rate is brought to
        the fit's; gait cycles are cut at any rate.
    missing
        Limbs (larm, rarm, lleg, rleg) or joints that are missing beside; what the clip holds
        for them is not looked at. Joints are called as in the clip or by their roles (``"left
        elbow"``, `bm.joint_roles`); of a gait-pose model as on the gait skeleton.
    cycle
        Which straight gait cycle of the clip is filled in, of a gait-pose model; from 1 on.
    draws
        At most so many draws of the fit, evenly spread.
    samples
        How many motions are drawn of every component, for `Reconstruction.draws`.
    seed
        Of random parts.

    Raises
    ------
    InputError
        If nothing is missing, a name is no joint's, there is no such cycle, or the model does
        not predict motions.

    Warns
    -----
    MotionWarning
        If the clip has another frame rate or trained the fit, or the fit's draws are not to be
        trusted.
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
        messages = _told("the reconstruction", fit, found.motion)
        return Reconstruction(motion, found.motion, poses, seen, told, None,
                              _channels(encoding, motion), None, messages, u)  # fmt: skip
    return _of_motions(fit, clip, missing, draws, samples, seed)


def denoise_cycle(
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

    Warns
    -----
    MotionWarning
        As `reconstruct`.
    """
    if not isinstance(fit.model, ConditionsOnCycles):
        raise lacking(fit.model.name, "it takes no noise out of motions", ConditionsOnCycles)
    found, trained = _cycle(fit, clip, missing, cycle, draws)
    encoding = trained.training.encoding
    u = encoding.scaled(found.motion)
    poses, level = gait.denoise(trained, u, noise)
    motion = encoding.motion(poses.means(), _name(found.motion, "denoised"))
    messages = _told("the denoised cycle", fit, found.motion)
    return Reconstruction(motion, found.motion, poses, np.isfinite(u), None, level,
                          _channels(encoding, motion), None, messages, u)  # fmt: skip


def _cycle(
    fit: Fit, clip: xr.Dataset, missing: Sequence[str], number: int, draws: int
) -> tuple[Incomplete, gait.Trained]:
    training = gait.cycles_of(fit)
    joints = gait.joints_named(training.encoding, missing)
    found = incomplete_cycle(clip, training.poses, number, joints)
    return found, gait.trained_of(fit, draws)


def _of_motions(
    fit: Fit, clip: xr.Dataset, missing: Sequence[str], draws: int, samples: int, seed: int
) -> Reconstruction:
    name = check_one_clip(clip)
    if not isinstance(fit.training, MotionData):
        raise lacking(fit.model.name, "it does not predict motions", MotionData, ConditionsOnCycles)
    clip, resampled = at_rate(clip, fit.frame_rate)
    given = _without(clip, missing)
    prediction = predict(fit, given, draws=draws, samples=samples, seed=seed)
    data = prediction.data
    ((site, mixture),) = prediction.sites.items()
    assert isinstance(mixture, Mixture), "values of motions are normal"
    observed = data.observed()[site].values
    seen = np.isfinite(observed)
    _require_missing(clip, seen)
    motion = prediction.motion({site: mixture.means()})
    motion = motion.assign_coords(clip=("frame", np.full(motion.sizes["frame"], name)))
    messages = _told("the reconstruction", fit, given, resampled)
    return Reconstruction(motion, given, mixture, seen, None, None,
                          channels_of(prediction, skeleton_of(motion)), prediction, messages,
                          data.units()[site].natural(observed))  # fmt: skip


def _without(clip: xr.Dataset, missing: Sequence[str]) -> xr.Dataset:
    """Return a clip without limbs, or joints by their own names, roles, or the gait skeleton's."""
    skeleton, roles = skeleton_of(clip), joint_roles(clip)
    turning, of_gait = turning_joints(skeleton), turning_joints(gait_skeleton())
    for name in missing:
        own = name if name in turning else roles.get(name)
        if own in turning:
            dofs = [f"{own}/{channel}" for channel in skeleton.joints[skeleton.index(own)].channels]
            clip = clip.assign(angle=clip["angle"].where(~clip["dof"].isin(dofs)))
        elif name in gait.LIMBS or name in of_gait:
            clip = without_joints(clip, gait.LIMBS.get(name, (name,)))
        else:
            names = ", ".join([*gait.LIMBS, *turning])
            raise InputError(f"joint {name!r}", "there is no such", f"Use some of {names}")
    return clip


def _require_missing(clip: xr.Dataset, seen: Bool[np.ndarray, "n d"]) -> None:
    if seen.all():
        name = str(clip["clip"].values[0])
        raise InputError(
            f"clip {name!r}", "nothing is missing in it", "Name joints or limbs as `missing`"
        )


def _told(task: str, fit: Fit, given: xr.Dataset, further: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return what is to be said of the fit and the clip, and warn of it."""
    messages = tuple(dict.fromkeys((*further, *cautions(fit, given))))
    warn(task, messages, stacklevel=4)
    return messages


def _channels(encoding: CycleEncoding, motion: xr.Dataset) -> Channels:
    """Return those of gait cycles: rotation vectors in radians."""
    name, scale = one_clip(motion), encoding.unit / encoding.lever
    labels = encoding.labels
    return Channels(
        labels, ["rad"] * len(labels), lambda y: encoding.motion(y, name), encoding.mean, scale
    )


def _name(cycle: xr.Dataset, what: str) -> str:
    return f"{cycle['clip'].values[0]} {what}"
