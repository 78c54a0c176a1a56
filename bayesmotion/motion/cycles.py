"""Gait cycles: walks cut from one left heel strike to the next, all of 30 poses on one body.

A cycle is a clip of its own, on the `gait_skeleton`, with the direction it goes in
turned to +z and the pelvis in one place. Its first pose is where the left foot is
farthest before the right one, which is within a few hundredths of a second of the
heel strike, and its poses are evenly spread in time, so that equal poses of different
people have equal phases.

What is missing of a recording is NaN, and missing (NaN) in its cycles, with all that hangs on
it. Where one foot is missing all through, it is taken to be where the other one is half a
cycle earlier and later.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation, Slerp

from ..errors import InputError
from . import kinematics
from .dataset import make_motion, skeleton_of
from .euler import continuous_angles
from .features import check_one_clip
from .gait_skeleton import (
    gait_skeleton,
    limb_rotations,
    source_joints,
    turning_joints,
    upright,
)
from .joining import concat, split
from .skeleton import Skeleton

POSES = 30
# One cycle a second, about as people walk: the rate at which cycles are written.
RATE = 30.0
SHORTEST, LONGEST = 0.7, 1.8  # seconds
SMOOTH = 0.05  # seconds, of the distance between the feet when its peaks are looked for
STRAIGHT = np.deg2rad(12.0)  # between the directions of the halves of a cycle
SLOWEST = 0.5  # leg lengths a second
LEAST_STEP = 0.25  # leg lengths: of a step
FACING = float(np.cos(np.deg2rad(30.0)))  # between where a body faces and where it goes


@dataclass(frozen=True)
class Cycle:
    """One gait cycle of a clip.

    start, end
        Frames of two left heel strikes, with fractions.
    heading
        Direction of travel: the angle about the vertical from +z.
    turned
        Direction of the second half less that of the first, in radians; the sway of the
        pelvis is in it, up to a tenth of a radian.
    speed
        Leg lengths a second.
    """

    start: float
    end: float
    heading: float
    turned: float
    speed: float


def find_cycles(motion: xr.Dataset) -> list[Cycle]:
    """Find the gait cycles of one clip that go straight on, forwards.

    Parameters
    ----------
    motion
        Motion of one clip, with a skeleton whose joints `source_joints` knows. One leg may be
        missing.

    Raises
    ------
    InputError
        If the root or both feet are missing.
    """
    rate = float(motion.attrs["frame_rate"])
    joint = _joints_told_by(motion)
    seen = [side for side in "lr" if np.isfinite(joint[f"{side}foot"]).any()]
    if not seen or not np.isfinite(joint["root"]).any():
        raise InputError(
            f"clip {check_one_clip(motion)!r}",
            "the root or both feet are missing: nothing tells where a gait cycle begins",
            "Give a recording of the root and one leg at least",
        )
    thigh, knee, foot = (joint[seen[0] + name] for name in ("femur", "tibia", "foot"))
    leg = _length(thigh, knee) + _length(knee, foot)
    way = _smooth_way(joint["root"][:, [0, 2]], rate)
    ahead = {
        side: np.sum((joint[f"{side}foot"] - joint["root"])[:, [0, 2]] * way, axis=1) / leg
        for side in seen
    }
    for side in set("lr") - set(seen):
        ahead[side] = _half_a_cycle_off(ahead[seen[0]], rate)
    apart = _smoothed(ahead["l"] - ahead["r"], SMOOTH * rate)
    forwards = np.sum(_facing(joint["lfemur"] - joint["rfemur"]) * way, axis=1)
    strikes = _strikes(apart, rate)
    found = []
    for start, end in pairwise(strikes):
        cycle = _cycle(joint["root"][:, [0, 2]] / leg, start, end, rate)
        usual = SHORTEST <= (end - start) / rate <= LONGEST
        during = slice(int(start), int(end))
        facing = forwards[during][np.isfinite(forwards[during])]
        usual = usual and facing.size > 0 and np.mean(facing) > FACING
        back = np.nanmin(apart[during]) < -LEAST_STEP
        if usual and back and abs(cycle.turned) < STRAIGHT and cycle.speed > SLOWEST:
            found.append(cycle)
    return found


def _joints_told_by(motion: xr.Dataset) -> dict[str, Float[np.ndarray, "n 3"]]:
    """Positions, y up, of the root and the joints of both legs in one clip; NaN where missing."""
    skeleton = skeleton_of(motion)
    check_one_clip(motion)
    sources = source_joints(skeleton)
    where, _ = kinematics.poses(skeleton, motion["angle"].values, motion["root_position"].values)
    where = where @ upright(skeleton, where).T
    names = ("root", *(side + name for side in "lr" for name in ("femur", "tibia", "foot")))
    return {name: where[:, skeleton.index(sources[name][0])] for name in names}


def _half_a_cycle_off(ahead: Float[np.ndarray, " n"], rate: float) -> Float[np.ndarray, " n"]:
    """How far one foot is ahead by the other one: the mean of half a cycle before and after.

    It is NaN everywhere where the other foot does not step twice.
    """
    frames = np.arange(len(ahead))
    steps = _peaks(_smoothed(ahead, SMOOTH * rate), 0.5 * LEAST_STEP, rate)
    half = 0.5 * float(np.median(np.diff(steps))) if len(steps) > 1 else np.nan
    sides = np.stack([
        np.interp(frames + off, frames, ahead, left=np.nan, right=np.nan) for off in (-half, half)
    ])  # fmt: skip
    known = np.isfinite(sides)
    total = np.where(known, sides, 0.0).sum(axis=0)
    return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)


def _strikes(apart: Float[np.ndarray, " n"], rate: float) -> list[float]:
    """Frames, with fractions, where the left foot is farthest before the right one."""
    peaks = _peaks(apart, LEAST_STEP, rate)
    # At the ends the smoothed distance has half a past or half a future: no peak is sure there.
    sure = 3.0 * SMOOTH * rate
    inside = peaks[(peaks >= sure) & (peaks < len(apart) - sure)]
    return [_refined(apart, peak) for peak in inside.tolist()]


def _peaks(ahead: Float[np.ndarray, " n"], least: float, rate: float) -> Int[np.ndarray, " peak"]:
    """Frames of the peaks of a distance, in leg lengths, that are as high as `least`."""
    # Half a second of imports, for recordings that are cut into cycles alone.
    from scipy.signal import find_peaks

    return find_peaks(ahead, height=least, distance=int(0.5 * SHORTEST * rate))[0]


def _smoothed(values: np.ndarray, sd: float) -> np.ndarray:
    """Smooth along the frames by a Gaussian of so many frames."""
    # Imported here for the same reason.
    from scipy.ndimage import gaussian_filter1d

    return gaussian_filter1d(values, sd, axis=0)


def _length(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.nanmedian(np.linalg.norm(a - b, axis=1)))


def _facing(across: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Where a body faces on the ground, whose left hip lies `across` of the right one."""
    ahead = np.stack([-across[:, 2], across[:, 0]], axis=1)
    return ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)


def _smooth_way(path: Float[np.ndarray, "n 2"], rate: float) -> Float[np.ndarray, "n 2"]:
    """Direction of travel at every frame, smoothed over half a second."""
    velocity = np.gradient(_smoothed(path, 0.5 * rate), axis=0)
    return velocity / np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), 1e-12)


def _refined(values: np.ndarray, peak: int) -> float:
    """Place of a peak between frames, by the parabola through three of them."""
    if not 0 < peak < len(values) - 1:
        return float(peak)
    before, at, after = values[peak - 1 : peak + 2].tolist()
    bend = before - 2.0 * at + after
    return float(peak) if bend == 0.0 else peak + 0.5 * (before - after) / bend


def _cycle(path: Float[np.ndarray, "n 2"], start: float, end: float, rate: float) -> Cycle:
    marks = [_between(path, mark) for mark in (start, 0.5 * (start + end), end)]
    first, second, whole = marks[1] - marks[0], marks[2] - marks[1], marks[2] - marks[0]
    angles = [float(np.arctan2(way[0], way[1])) for way in (first, second, whole)]
    turned = (angles[1] - angles[0] + np.pi) % (2.0 * np.pi) - np.pi
    speed = float(np.linalg.norm(whole)) * rate / (end - start)
    return Cycle(start, end, angles[2], float(turned), speed)


def _between(values: np.ndarray, mark: float) -> np.ndarray:
    low = min(int(mark), len(values) - 2)
    return values[low] + (mark - low) * (values[low + 1] - values[low])


def cut_cycle(motion: xr.Dataset, cycle: Cycle, name: str, poses: int = POSES) -> xr.Dataset:
    """Cut a cycle out of its clip and put it on the gait skeleton.

    Parameters
    ----------
    motion
        The clip that `find_cycles` looked at.
    cycle
        One of those it found.
    name
        Of the clip that is made. It is also its label ``gait``; its ``scale`` is "1".
    poses
        Number of poses, evenly spread in time from `start` on; `end` is the next cycle's first.

    Returns
    -------
    Motion of `poses` frames, labelled with subject, gait and scale; NaN where a pose lies between
    frames of which one is missing.
    """
    clip = check_one_clip(motion)
    first, last = int(np.floor(cycle.start)), int(np.ceil(cycle.end))
    part = motion.isel(frame=slice(first, last + 1))
    turn_back = Rotation.from_rotvec([0.0, -cycle.heading, 0.0]).as_matrix()
    world = turn_back @ limb_rotations(part)
    at = cycle.start - first + np.arange(poses) * (cycle.end - cycle.start) / poses
    target = gait_skeleton()
    local = {}
    for index, joint in enumerate(turning_joints(target)):
        parent = target.joints[target.joints[target.index(joint)].parent].name
        own = world[:, index]
        if joint != "root":
            above = world[:, turning_joints(target).index(parent)]
            own = above.swapaxes(-1, -2) @ own
        local[joint] = _turned_at(own, at)
    subject = str(motion["subject"].values[0])
    seconds = (cycle.end - cycle.start) / float(motion.attrs["frame_rate"])
    return from_rotations(
        local,
        target,
        clip=name,
        labels={"subject": subject, "gait": name, "scale": "1"},
        history=f"cycle of {seconds:.2f} s of {clip}, from frame {cycle.start:.1f}",
    )


def _turned_at(turned: Float[np.ndarray, "n 3 3"], at: Float[np.ndarray, " t"]) -> Rotation:
    """Rotations between frames; NaN next to a frame where they are missing."""
    known = np.isfinite(turned).all(axis=(1, 2))
    filled = np.where(known[:, None, None], turned, np.eye(3))
    between = Slerp(np.arange(len(turned)), Rotation.from_matrix(filled))(at)
    lost = ~(known[np.floor(at).astype(int)] & known[np.ceil(at).astype(int)])
    if not lost.any():
        return between
    return Rotation.from_rotvec(np.where(lost[:, None], np.nan, between.as_rotvec()))


def from_rotations(
    local: dict[str, Rotation],
    target: Skeleton,
    *,
    clip: str,
    labels: dict[str, str],
    history: str = "",
) -> xr.Dataset:
    """Make the Motion of a cycle from the rotations of its joints against their parents."""
    columns = [continuous_angles(local[name], "ZYX") for name in turning_joints(target)]
    height = -sum(joint.offset[1] for joint in target if joint.name in _LEFT_LEG)
    n = len(columns[0])
    return make_motion(
        target,
        np.concatenate(columns, axis=1),
        np.tile([0.0, height, 0.0], (n, 1)),
        frame_rate=RATE,
        clip=clip,
        labels=labels,
        history=history,
        allow_missing=True,
    )


_LEFT_LEG = ("lfemur", "ltibia", "lfoot", "lfoot_end")


def rotation_vectors(motion: xr.Dataset) -> Float[np.ndarray, "frame joint 3"]:
    """Give the rotation of every joint of a cycle against its parent as a vector (radians).

    It is NaN where one of the joint's angles is missing.

    Raises
    ------
    InputError
        If the clip is not on a skeleton whose turning joints have three channels.
    """
    skeleton = skeleton_of(motion)
    vectors = []
    for name in turning_joints(skeleton):
        channels = skeleton.joints[skeleton.index(name)].channels
        if len(channels) != 3:
            raise InputError(
                f"skeleton {skeleton.name!r}",
                f"{name!r} turns about {len(channels)} axes",
                "Cut cycles with cycles_of(), which puts them on the gait skeleton",
            )
        euler = motion["angle"].sel(dof=[f"{name}/{c}" for c in channels]).values
        order = "".join(channel[1].upper() for channel in channels)
        vectors.append(Rotation.from_euler(order, euler).as_rotvec())
    return np.stack(vectors, axis=1)


def joint_positions(
    vectors: Float[np.ndarray, "frame joint 3"], skeleton: Skeleton
) -> Float[np.ndarray, "frame all_joints 3"]:
    """Give the positions of all joints, ends too, with the root where it is.

    Parameters
    ----------
    vectors
        As `rotation_vectors` gives them.
    skeleton
        The gait skeleton; positions are in its unit, millimetres.
    """
    n, joints = vectors.shape[:2]
    euler = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_euler("ZYX")
    return kinematics.poses(skeleton, euler.reshape(n, 3 * joints), np.zeros((n, 3)))[0]


def diversified(motion: xr.Dataset, scale: float) -> xr.Dataset:
    """Give cycles a longer or a shorter stride: eq. 5 of Ding and Fan.

        y' = mean + scale (y - mean),

    for every component of every joint's rotation vector, with the mean over the cycle.

    Parameters
    ----------
    motion
        Cycles on the gait skeleton.
    scale
        Above 1 for longer strides.

    Returns
    -------
    The cycles with the label ``scale``, named ``<clip> x<scale>`` unless it is 1.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputError("scale", f"it is {scale}", "Give a number above zero")
    made = []
    for clip, part in split(motion).items():
        vectors = rotation_vectors(part)
        mean = vectors.mean(axis=0)
        scaled = vectors if scale == 1 else mean + scale * (vectors - mean)
        name = clip if scale == 1 else f"{clip} x{scale:g}"
        labels = {label: str(part[label].values[0]) for label in ("subject", "gait")}
        labels["scale"] = f"{scale:g}"
        made.append(from_vectors(scaled, skeleton_of(part), clip=name, labels=labels))
    return concat(made)


def from_vectors(
    vectors: Float[np.ndarray, "frame joint 3"],
    skeleton: Skeleton,
    *,
    clip: str,
    labels: dict[str, str],
) -> xr.Dataset:
    """Make the Motion of a cycle from rotation vectors, undoing `rotation_vectors`."""
    names = turning_joints(skeleton)
    local = {name: Rotation.from_rotvec(vectors[:, i]) for i, name in enumerate(names)}
    return from_rotations(local, skeleton, clip=clip, labels=labels)


def some_cycles(motion: xr.Dataset) -> list[Cycle]:
    """Return what `find_cycles` finds in one clip, one cycle at least.

    Raises
    ------
    InputError
        If there is none.
    """
    found = find_cycles(motion)
    if not found:
        raise InputError(
            f"clip {check_one_clip(motion)!r}",
            "it has no whole straight gait cycle",
            "Leave the clip out",
        )
    return found


def cycles_of(motion: xr.Dataset, most: int | None = None, poses: int = POSES) -> xr.Dataset:
    """Cut the straight gait cycles out of clips, the straightest ones first if not all.

    Parameters
    ----------
    motion
        Clips of people walking.
    most
        At most so many of each clip.
    poses
        Of every cycle.

    Raises
    ------
    InputError
        If a clip has no straight cycle.
    """
    made = []
    for clip, part in split(motion).items():
        straightest = sorted(some_cycles(part), key=lambda cycle: abs(cycle.turned))[:most]
        for number, cycle in enumerate(sorted(straightest, key=lambda cycle: cycle.start)):
            made.append(cut_cycle(part, cycle, f"{clip}#{number + 1}", poses))
    return concat(made)
