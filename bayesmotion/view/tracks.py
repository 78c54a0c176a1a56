"""Tracks of a scene made of motions, voxels, and what tasks and predictions say.

Bodies are turned upright (`upright`), brought to metres as in pictures (`plots.bodies`), stand on
the floor, and begin in one place, so that what is laid over each other can be compared; with
voxels, which have a place in the world, everything stays where it was.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from ..fit import Fit
from ..inference.predicting import Prediction
from ..model import MotionData
from ..motion.dataset import clips, skeleton_of
from ..motion.joining import split
from ..motion.kinematics import positions
from ..motion.sides import sides
from ..plots.bodies import bones_of, head_of, metres_of, stature_of
from ..prediction import Mixture
from ..sensing.voxels.carving import hulls
from ..tasks.forecast import Forecast
from ..tasks.gaps import FilledGaps
from ..tasks.outcome import chosen_samples, features_drawn
from ..tasks.reconstruct import Reconstruction
from ..tasks.recording import Denoised
from ..tasks.synthesise import Synthesis
from .scene import Cloud, Ghosts, Role, Track
from .upright import upright

# What a task says of a motion.
Outcome = Forecast | Reconstruction | Synthesis | Denoised | FilledGaps
# Fewer draws do not tell how far they are apart; so many poses are drawn where there are none.
FEWEST, POSES = 8, 40
SIDES = {"left": 0, "right": 1, "centre": 2}
# The floor is where the lowest joint is at this quantile of the frames.
FLOOR = 0.05


def tracks_of_motion(
    motion: xr.Dataset, role: Role = "motion", *, names: Sequence[str] = ()
) -> list[Track]:
    """Return a track for every clip of a Motion.

    Parameters
    ----------
    motion
        Any, of bodies or of markers, y up.
    role
        What they are.
    names
        What the clips are called here; as in the Motion where there are none.

    Raises
    ------
    InputError
        If nothing is known of where a clip's joints are.
    """
    parts = split(motion)
    return [
        _track(part, name, role)
        for name, part in zip(names or list(parts), parts.values(), strict=True)
    ]


def tracks_of_outcome(outcome: Outcome, draws: int, seed: int = 0) -> list[Track]:
    """Return what a task was given of a clip, if it changed that, and the mean of what it says.

    Draws of the mean are its ghosts.

    Parameters
    ----------
    outcome
        What the task returned.
    draws
        At most so many ghosts.
    seed
        Of the choice among the draws.
    """
    track = _track(outcome.motion, clips(outcome.motion)[0], "mean")
    if isinstance(outcome, Denoised):
        whole = _with_spread(track, outcome.mixture, outcome.to_motion, outcome.root_sd)
        return [_track(outcome.given, "given", "truth"), whole]
    if isinstance(outcome, FilledGaps):
        # The sd is that of each of three coordinates.
        metres = float(outcome.motion.attrs.get("metres", 1.0))
        sure = Ghosts(track.where[None][:0], np.sqrt(3.0) * metres * outcome.sd)
        return [_track(outcome.given, "given", "truth"), replace(track, ghosts=sure)]
    if isinstance(outcome, Reconstruction):
        given = _track(outcome.given, "given", "truth")
        if outcome.samples is None:
            assert outcome.channels is not None, "made by reconstruct() or denoise_cycle()"
            return [given, _with_spread(track, outcome.mixture, outcome.channels.to_motion)]
        return [given, _with_ghosts(track, outcome.motion, outcome.draws(draws, seed))]
    track = _with_ghosts(track, outcome.motion, outcome.draws(draws, seed))
    if isinstance(outcome, Forecast):
        return [replace(track, context=outcome.context)]
    return [track]


def tracks_of_prediction(prediction: Prediction, draws: int, seed: int = 0) -> list[Track]:
    """Return the mean of a prediction of motions, clip by clip, with draws of it as ghosts.

    Parameters
    ----------
    prediction
        Of motions.
    draws
        At most so many ghosts.
    seed
        Of the choice among the draws.

    Raises
    ------
    InputError
        If it is none of motions.
    """
    if not isinstance(prediction.data, MotionData) or len(prediction.sites) != 1:
        raise InputError(
            "prediction", "it is none of motions, of which there are bodies to be seen",
            "View its recordings, or draw its table (to_dataset)",
        )  # fmt: skip
    ((site, mixture),) = prediction.sites.items()
    means = split(prediction.motion({site: mixture.means()}))
    drawn = [split(prediction.motion({site: y})) for y in chosen_samples(prediction, draws, seed)]
    return [
        _with_ghosts(_track(part, name, "mean"), part, [one[name] for one in drawn])
        for name, part in means.items()
    ]


def tracks_of_fit(fit: Fit) -> list[Track]:
    """Return the training clips of a fit.

    Raises
    ------
    InputError
        If they are no motions.
    """
    if "root_position" in fit.motion or "position" in fit.motion:
        return tracks_of_motion(fit.motion)
    raise InputError(
        f"fit of {fit.model.name}", "it was trained on no bodies that could be seen moving",
        "View a fit of motions, or write a report of this one (bm.report)",
    )  # fmt: skip


def clouds_of(voxels: xr.Dataset) -> list[Cloud]:
    """Return the surfaces of voxels, frame by frame, a cloud for every clip.

    Parameters
    ----------
    voxels
        As `sensing.voxels.carving.carve` and `voxel_recordings` make them.
    """
    shells, clip = [hull.shell for hull in hulls(voxels)], voxels["clip"].values
    out = []
    for name, side in json.loads(str(voxels.attrs["side"])).items():
        own = [shells[frame] for frame in np.flatnonzero(clip == name)]
        where, counts = (np.concatenate(own) + 0.5) * side, np.array([len(one) for one in own])
        rate = float(voxels.attrs["frame_rate"])
        out.append(Cloud(f"voxels of {name}", where, counts, float(side), rate))
    return out


def in_one_place(tracks: Sequence[Track]) -> list[Track]:
    """Return tracks on one floor, that begin over the same place of it.

    A prediction stands on the floor of the truth before it, on which it would not be laid where
    it sinks; without one on that of its context. Ghosts go with their mean.
    """
    out, truth = [], None
    for track in tracks:
        floor = _floor(track.where[: track.context])
        if track.role == "truth":
            truth = floor
        elif track.role == "mean" and truth is not None:
            floor = truth
        out.append(_moved(track, -_start(track) - np.array([0.0, floor, 0.0])))
    return out


def _track(motion: xr.Dataset, name: str, role: Role) -> Track:
    """Return the track of one clip."""
    rate = float(motion.attrs["frame_rate"])
    if "position" in motion:
        return _markers(motion, name, role, rate)
    skeleton = skeleton_of(motion)
    where = _places(motion, skeleton.names)
    where = where @ upright(where, skeleton.names).T
    where = where * metres_of(skeleton, where)
    side = tuple(SIDES[side] for side in sides(skeleton.names))
    return Track(
        name, role, where, skeleton.names, bones_of(skeleton), side, head_of(skeleton),
        stature_of(where), rate,
    )  # fmt: skip


def _markers(motion: xr.Dataset, name: str, role: Role, rate: float) -> Track:
    """Return the track of a clip of which only markers are known."""
    names = tuple(str(joint) for joint in motion["joint"].values)
    where = motion["position"].transpose("frame", "joint", "space").values
    _require_known(motion, where)
    where = where @ upright(where, names).T * float(motion.attrs.get("metres", 1.0))
    side = tuple(SIDES[one] for one in sides(names))
    bones = np.zeros((0, 2), dtype=int)
    return Track(name, role, where, names, bones, side, None, stature_of(where), rate)


def _places(motion: xr.Dataset, names: Sequence[str]) -> Float[np.ndarray, "n j 3"]:
    """Return where the joints of one clip are, in the skeleton's unit."""
    where = positions(motion).sel(joint=list(names)).values
    _require_known(motion, where)
    return where


def _require_known(motion: xr.Dataset, where: np.ndarray) -> None:
    if not np.isfinite(where).all(axis=2).any():
        raise InputError(
            f"clip {clips(motion)[0]!r}", "it is not known where any joint is",
            "Give a clip with a root's path and joint angles",
        )  # fmt: skip


def _floor(where: np.ndarray) -> float:
    """Return the height of the floor, under the lowest joint of most frames."""
    seen = where[np.isfinite(where[..., 1]).any(axis=1)]
    return float(np.quantile(np.nanmin(seen[..., 1], axis=1), FLOOR))


def _with_ghosts(track: Track, motion: xr.Dataset, drawn: Sequence[xr.Dataset]) -> Track:
    """Return a track with draws of its motion."""
    if not drawn:
        return track
    skeleton = skeleton_of(motion)
    mean = _places(motion, skeleton.names)
    turn = upright(mean, skeleton.names).T
    mean = mean @ turn
    each = np.stack([_places(one, skeleton.names) for one in drawn]) @ turn
    # The vertical and metres are those of the mean.
    where = each * metres_of(skeleton, mean)
    sd = _spread(where) if len(drawn) >= FEWEST else None
    return replace(track, ghosts=Ghosts(where, sd))


def _with_spread(
    track: Track,
    mixture: Mixture,
    to_motion: Callable[[Float[np.ndarray, "n d"]], xr.Dataset],
    root_sd: Float[np.ndarray, "n 3"] | None = None,
) -> Track:
    """Return a track whose frames are told one by one: how sure they are, and no ghosts.

    Drawn as they are told, poses would tremble.
    """
    drawn = [to_motion(features) for features in features_drawn(mixture, POSES)]
    skeleton = skeleton_of(drawn[0])
    each = np.stack([_places(one, skeleton.names) for one in drawn])
    each = each @ upright(each[0], skeleton.names).T
    variance = _spread(each) ** 2
    if root_sd is not None:
        variance = variance + (root_sd**2).sum(axis=1, keepdims=True)
    sd = np.sqrt(variance) * metres_of(skeleton, each[0])
    return replace(track, ghosts=Ghosts(track.where[None][:0], sd))


def _spread(where: Float[np.ndarray, "s n j 3"]) -> Float[np.ndarray, "n j"]:
    """Return the root mean square distance of joints from their means."""
    away = where - where.mean(axis=0)
    return np.sqrt((away**2).sum(axis=-1).sum(axis=0) / (len(where) - 1))


def _start(track: Track) -> Float[np.ndarray, " 3"]:
    """Return where a track begins on the floor."""
    known = np.isfinite(track.where).all(axis=2)
    frame = int(np.flatnonzero(known.any(axis=1))[0])
    root = known[frame, 0] and len(track.bones) > 0
    place = track.where[frame, 0] if root else track.where[frame][known[frame]].mean(axis=0)
    return place * [1.0, 0.0, 1.0]


def _moved(track: Track, by: Float[np.ndarray, " 3"]) -> Track:
    ghosts = track.ghosts and Ghosts(track.ghosts.where + by, track.ghosts.sd)
    return replace(track, where=track.where + by, ghosts=ghosts)
