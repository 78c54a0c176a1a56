"""Gait cycles of which joints are missing: cut, and what fills them in judged.

Missing is NaN. Joints that are said to be missing are made NaN in the recording before
anything else looks at it, also before cycles are found; what hangs on them is missing with
them. What the recording holds for them is a truth to judge by, unless it is NaN too or stands
still over the whole cycle, as zeros do that were written in the place of nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from ..motion.cycles import cut_cycle, some_cycles
from ..motion.features import check_one_clip
from ..motion.gait_skeleton import still_joints, turning_joints, without_joints
from ..prediction import Mixture
from .gait import LIMBS, Trained
from .pose_baselines import fit_pca, mean_cycle, nearest_pose

# Principal components of the baseline: as many as the latent space has dimensions.
COMPONENTS = 3


@dataclass(frozen=True)
class Incomplete:
    """A gait cycle of which joints may be missing.

    motion
        The cycle on the gait skeleton, NaN where missing.
    truth
        The cycle as recorded; NaN where that is no truth.
    still
        Joints said to be missing that the recording holds at rest over the whole cycle.
    limbs_at_rest
        Limbs that were not said to be missing, but are at rest over the whole cycle.
    """

    motion: xr.Dataset
    truth: xr.Dataset
    still: tuple[str, ...]
    limbs_at_rest: tuple[str, ...]


def incomplete_cycle(
    motion: xr.Dataset, poses: int, number: int = 1, missing: Sequence[str] = ()
) -> Incomplete:
    """Return a straight gait cycle of a clip without the joints that are missing.

    Parameters
    ----------
    motion
        Motion of one clip, NaN where angles are missing.
    poses
        Of the cycle.
    number
        Which of the clip's straight cycles, from 1 on.
    missing
        Joints of the gait skeleton whose values in `motion` are not to be looked at.

    Raises
    ------
    InputError
        If there is no such cycle, or too much is missing to tell cycles.
    """
    clip = check_one_clip(motion)
    seen = without_joints(motion, missing)
    found = some_cycles(seen)
    if not 1 <= number <= len(found):
        raise InputError(
            f"cycle {number}", f"{clip!r} has {len(found)} straight cycles", "Take one of those"
        )
    cycle, name = found[number - 1], f"{clip}#{number}"
    during = motion.isel(frame=slice(int(np.floor(cycle.start)), int(np.ceil(cycle.end)) + 1))
    still = still_joints(during, missing)
    at_rest = tuple(
        limb
        for limb, joints in LIMBS.items()
        if not set(joints) & set(missing) and len(still_joints(during, joints)) == len(joints)
    )
    return Incomplete(
        cut_cycle(seen, cycle, name, poses),
        cut_cycle(without_joints(motion, still), cycle, name, poses),
        still,
        at_rest,
    )


@dataclass(frozen=True)
class Score:
    """How far off what was filled in is, where that can be told.

    error_mm
        Mean distance in mm of the joints whose places were not known from where they are, over
        poses; None where there is no truth, or no joint moves with what is missing.
    baselines_mm
        The same of the mean training cycle in phase, of principal components and of the
        nearest training pose, by name.
    coverage90
        Share of the missing angles in their 90 % intervals; None without a truth.
    why
        Why there is no error, or none of some joints; None where all that was filled in is told.
    """

    error_mm: float | None
    baselines_mm: dict[str, float]
    coverage90: float | None
    why: str | None


def score(
    trained: Trained,
    u: Float[np.ndarray, "t d"],
    pose: Mixture,
    truth: Float[np.ndarray, "t d"] | None = None,
    still: Sequence[str] = (),
) -> Score:
    """Compare what was filled in with what was recorded, and with baselines.

    Parameters
    ----------
    u
        (T, D) features that were given, NaN where missing.
    pose
        What `reconstruct` or `denoise` made of them.
    truth
        (T, D) features as recorded, NaN where that is not known; None if nothing is.
    still
        Joints that `truth` lacks because they were at rest: told in `why`.
    """
    missing = np.isnan(u)
    if truth is None:
        return Score(None, {}, None, "no truth was given")
    told = missing & np.isfinite(truth)
    unknown = missing_joints(trained, np.where(missing, truth, 0.0))
    why = _why_no_truth(unknown, still) if unknown else None
    if not told.any():
        return Score(None, {}, None, why)
    inside = np.abs(pose.probability(truth) - 0.5)[told] <= 0.45
    encoding = trained.training.encoding
    where = encoding.positions(truth)
    # A joint hangs on missing ones where it has no place.
    moved = np.isnan(encoding.positions(u)).any(axis=-1) & np.isfinite(where).all(axis=-1)
    coverage = float(inside.mean())
    if not moved.any():
        return Score(None, {}, coverage, "no joint with a known place hangs on the missing ones")

    def error(made: np.ndarray) -> float:
        # What is seen stays as it is.
        off = encoding.positions(np.where(missing, made, u)) - where
        return float(np.linalg.norm(off, axis=-1)[moved].mean())

    found = {name: error(made) for name, made in baselines(trained, u).items()}
    return Score(error(pose.means()), found, coverage, why)


def _why_no_truth(unknown: Sequence[str], still: Sequence[str]) -> str:
    if not still:
        return f"the recording has no values for {', '.join(unknown)}"
    return (
        f"the recording holds {', '.join(still)} still over the whole cycle, "
        "which is taken for not recorded"
    )


def baselines(trained: Trained, u: Float[np.ndarray, "t d"]) -> dict[str, Float[np.ndarray, "t d"]]:
    """Return what simple ways make of a cycle (T, D), by name, NaN in `u` being missing.

    They go by complete training cycles.
    """
    training, seen = trained.training, np.isfinite(u)
    cycles = np.asarray(training.frames.y).reshape(-1, training.poses, u.shape[1])
    whole = training.complete_cycles().reshape(len(training.scales), -1)
    y = cycles[whole.ravel()].reshape(-1, u.shape[1])
    layer = int(np.argmin(np.abs(np.log(training.scales))))
    recorded = cycles.reshape(*whole.shape, *cycles.shape[1:])[layer, whole[layer]]
    return {
        "mean_cycle": mean_cycle(recorded),
        "pca": fit_pca(y, COMPONENTS).fill(u, seen),
        "nearest_pose": nearest_pose(y, u, seen),
    }


def missing_joints(trained: Trained, u: Float[np.ndarray, "t d"]) -> list[str]:
    """Return the joints of which something is missing (NaN) in a cycle."""
    lost = np.isnan(u).any(axis=0).reshape(-1, 3).any(axis=1)
    names = turning_joints(trained.training.encoding.skeleton)
    return [name for name, gone in zip(names, lost, strict=True) if gone]
