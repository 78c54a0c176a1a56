"""Looking recordings over for what no body does and recording systems do.

The limits are far beyond what people reach, so that a finding means a defect of the
recording, and unit-free, so that they hold for any skeleton.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from ..dataset import clips, skeleton_of
from ..joining import split
from ..kinematics import poses
from .findings import Finding

# Body heights a second. World record sprinters reach 12.4 m/s, 6.4 of their heights.
ROOT_SPEED = 6.5
# The fastest hands and feet (throwing, kicking) reach some 25 m/s, 14 body heights.
JOINT_SPEED = 15.0
# Radians a second. Nothing in the body turns faster than a pitcher's upper arm about
# its own axis, at up to 9000 degrees a second.
TURN_SPEED = 160.0
# Radians from one frame to the next by which a joint leaves an angle of exactly zero
# when its solving sets in; a body that starts to move leaves zero gradually.
REST_TURN = 0.2
# Frames in a row that agree to the last digit; measured frames never do.
FROZEN = 3
# Heights of the body that the root is at least above the lowest joint, if there are legs.
LEGS = 0.25
# Leg lengths that the lowest joint is below its usual height; stairs stay below this.
BELOW_FLOOR = 0.5
# Seconds from an end of a clip within which a jump is mended by cutting the clip.
EDGE = 0.1
_RIGHT = {"left": "right", "l": "r"}
# Seconds in the rest pose after which cutting would cost more than it mends.
LATE = 0.5


@dataclass(frozen=True)
class _Body:
    """One clip as arrays; lengths in the skeleton's unit."""

    motion: xr.Dataset
    where: np.ndarray  # (frame, joint, 3)
    turned: np.ndarray | None  # (frame, joint, 3, 3), relative to the parent
    names: tuple[str, ...]
    rest: np.ndarray | None  # (joint, 3)

    @cached_property
    def clip(self) -> str:
        """Name of the clip."""
        return clips(self.motion)[0]

    @cached_property
    def rate(self) -> float:
        """Frames a second."""
        return float(self.motion.attrs["frame_rate"])

    @cached_property
    def values(self) -> np.ndarray:
        """Everything recorded, (frame, column)."""
        parts = [variable.values for variable in self.motion.data_vars.values()]
        return np.hstack([part.reshape(len(part), -1) for part in parts])

    @cached_property
    def columns(self) -> list[str]:
        """Whose the columns of `values` are: joints, the root path, or markers."""
        names: list[str] = []
        for name in self.motion.data_vars:
            if name == "angle":
                names += [str(dof).rsplit("/", 1)[0] for dof in self.motion["dof"].values]
            elif name == "position":
                names += np.repeat(self.motion["joint"].values, 3).tolist()
            else:
                names += ["the root path"] * 3
        return names

    @cached_property
    def height(self) -> float:
        """Height of the body: the largest extent of the rest pose, else of the markers.

        NaN where there is none: no joint has a length, or no frame two markers.
        """
        if self.rest is not None:
            return float(np.ptp(self.rest, axis=0).max()) or np.nan
        seen = np.isfinite(self.where).all(axis=-1)
        # A frame that lacks half of the markers does not show how tall the body is.
        most = self.where[seen.sum(axis=1) > 0.5 * seen.sum(axis=1).max(initial=0)]
        if not most.size:
            return np.nan
        extents = np.nanmax(most, axis=1) - np.nanmin(most, axis=1)
        return float(np.median(extents.max(axis=1))) or np.nan

    @cached_property
    def turns(self) -> np.ndarray:
        """Angles in radians by which the joints turn from frame to frame, (step, joint)."""
        assert self.turned is not None
        return _angle_of(np.swapaxes(self.turned[:-1], -1, -2) @ self.turned[1:])


def check(motion: xr.Dataset) -> list[Finding]:
    """Look for defects of the recording in every clip.

    Found are: skeletons that no body has (a left limb below a right one, where a brace was
    lost); joints in the rest pose at the start (the T-pose of the CMU BVH release,
    limbs whose solving sets in late); jumps and flips faster than any body; stretches
    of identical frames; a body far below the floor (height along y); missing values.

    Parameters
    ----------
    motion
        Any Motion. Of marker positions, only jumps, frozen stretches and missing values
        can be told.

    Returns
    -------
    Findings, clip by clip; none for a sound recording.
    """
    findings: list[Finding] = []
    for part in split(motion).values():
        body = _body(part)
        rest = list(_rest_pose(body))
        # Leaving the rest pose is a jump, too, and need not be told twice.
        left = {finding.frames[1] for finding in rest}
        rest += [f for f in (*_jumps(body), *_flips(body)) if f.frames[0] not in left]
        findings += [*_mixed_sides(body), *rest, *_frozen(body), *_floor(body), *_missing(body)]
    return findings


def _body(part: xr.Dataset) -> _Body:
    """Work out positions and local rotations of one clip."""
    if "angle" not in part:
        names = tuple(part["joint"].values.tolist())
        return _Body(part, part["position"].values, None, names, None)
    skeleton = skeleton_of(part)
    where, turned = poses(skeleton, part["angle"].values, part["root_position"].values)
    parents = np.array([max(joint.parent, 0) for joint in skeleton])
    local = np.swapaxes(turned[:, parents], -1, -2) @ turned
    local[:, 0] = turned[:, 0]
    rest, _ = poses(skeleton, np.zeros((1, len(skeleton.dofs))), np.zeros((1, 3)))
    return _Body(part, where, local, skeleton.names, rest[0])


def _mixed_sides(body: _Body) -> Iterator[Finding]:
    """Find a joint of one side that hangs below one of the other."""
    if body.turned is None:
        return
    joints = skeleton_of(body.motion).joints
    names = set(body.names)
    mirrored = {left: right for left in body.names if (right := _right_of(left, names))}
    sides = dict.fromkeys(mirrored, "left") | dict.fromkeys(mirrored.values(), "right")
    for joint in joints:
        above = joint.parent
        while above >= 0 and joint.name in sides:
            other = joints[above].name
            if sides.get(other, sides[joint.name]) != sides[joint.name]:
                yield Finding(
                    body.clip,
                    "skeleton",
                    (0, len(body.where) - 1),
                    f"{joint.name} hangs below {other}, which is of the other side: a brace or a "
                    "line of the hierarchy may be lost.",
                )
                return
            above = joints[above].parent


def _right_of(name: str, names: set[str]) -> str | None:
    """Give the joint of the right side that is called like one of the left, if there is one."""
    for found in re.finditer(r"left|^l|(?<![a-z])l(?![a-z])", name, re.IGNORECASE):
        word = _RIGHT[found[0].lower()]
        word = word.upper() if found[0].isupper() else word
        word = word.capitalize() if found[0].istitle() else word
        other = name[: found.start()] + word + name[found.end() :]
        if other in names:
            return other
    return None


def _rest_pose(body: _Body) -> Iterator[Finding]:
    """Find joints that start at exactly zero and leave it with a jerk."""
    if body.turned is None:
        return
    at_rest = _angle_of(body.turned) < 1e-6
    first = np.where(at_rest.all(axis=0), 0, at_rest.argmin(axis=0))  # frames at rest
    leaves: dict[int, list[int]] = {}
    for joint, count in enumerate(first.tolist()):
        if joint and count and body.turns[count - 1, joint] > REST_TURN:
            leaves.setdefault(count, []).append(joint)
    for count, joints in sorted(leaves.items()):
        yield Finding(
            body.clip,
            "rest pose",
            (0, count - 1),
            f"{_names(body, joints)} in the rest pose up to frame {count - 1}.",
            tuple(range(count)) if count <= LATE * body.rate else (),
        )


def _jumps(body: _Body) -> Iterator[Finding]:
    """Find steps on which joints move faster than any body does."""
    steps = np.linalg.norm(np.diff(body.where, axis=0), axis=-1) * body.rate / body.height
    limits = np.full(len(body.names), JOINT_SPEED)
    if body.turned is not None:
        limits[0] = ROOT_SPEED
    for first, last in _runs((steps > limits).any(axis=1), gap=round(EDGE * body.rate)):
        part = steps[first:last]
        joints = np.flatnonzero((part > limits).any(axis=0))
        yield Finding(
            body.clip,
            "jump",
            (first, last),
            f"{_names(body, joints)} at up to {np.nanmax(part[:, joints]):.0f} body heights a "
            f"second between frames {first} and {last}.",
            _edge(body, first, last),
        )


def _flips(body: _Body) -> Iterator[Finding]:
    """Find steps on which joints turn faster than any joint does."""
    if body.turned is None:
        return
    fast = body.turns * body.rate > TURN_SPEED
    for first, last in _runs(fast.any(axis=1), gap=round(EDGE * body.rate)):
        joints = np.flatnonzero(fast[first:last].any(axis=0))
        degrees = np.degrees(np.nanmax(body.turns[first:last][:, joints]))
        yield Finding(
            body.clip,
            "flip",
            (first, last),
            f"{_names(body, joints)} turned by up to {degrees:.0f} degrees from one frame to the "
            f"next between frames {first} and {last}.",
        )


def _frozen(body: _Body) -> Iterator[Finding]:
    """Find frames that repeat the one before."""
    same = (np.diff(body.values, axis=0) == 0.0).all(axis=1)
    for first, last in _runs(same, gap=0):
        if last - first + 1 >= FROZEN:
            sentence = f"frames {first} to {last} are identical."
            yield Finding(body.clip, "frozen", (first, last), sentence, _end(body, first, last))


def _floor(body: _Body) -> Iterator[Finding]:
    """Find frames in which the lowest joint is far below where it usually is."""
    if body.rest is None or not np.ptp(body.rest[:, 1]) >= 0.5 * body.height:
        return  # y is not the way up: there is no knowing where the floor is
    if body.turned is not None and not np.nanmedian(body.turned[:, 0, 1, 1]) > 0.5:
        return  # nor is it in a recording whose rest pose lies
    leg = body.rest[0, 1] - body.rest[:, 1].min()
    if leg < LEGS * body.height:
        return  # a body without legs stands on no floor
    lowest = body.where[..., 1].min(axis=1)
    usual = np.median(lowest[np.isfinite(lowest)]) if np.isfinite(lowest).any() else np.nan
    below = (usual - lowest) / leg
    for first, last in _runs(below > BELOW_FLOOR, gap=0):
        sentence = (
            f"the lowest joint is {below[first:last].max():.1f} leg lengths below its usual "
            f"height in frames {first} to {last - 1}."
        )
        yield Finding(body.clip, "floor", (first, last - 1), sentence, _end(body, first, last - 1))


def _missing(body: _Body) -> Iterator[Finding]:
    """Find frames with missing values."""
    lost = np.isnan(body.values)
    for first, last in _runs(lost.any(axis=1), gap=0):
        columns = np.flatnonzero(lost[first:last].any(axis=0))
        whose = _listed(list(dict.fromkeys(body.columns[column] for column in columns)))
        sentence = f"values of {whose} are missing in frames {first} to {last - 1}."
        # Cutting clips where one marker of many is hidden would cost more than it mends.
        cut = _end(body, first, last - 1) if body.turned is not None else ()
        yield Finding(body.clip, "missing", (first, last - 1), sentence, cut)


def _angle_of(rotation: np.ndarray) -> np.ndarray:
    """Give the angle of rotation matrices, precise near zero too."""
    trace = np.trace(rotation, axis1=-2, axis2=-1)
    twist = rotation - np.swapaxes(rotation, -1, -2)
    sine = np.linalg.norm(twist[..., [2, 0, 1], [1, 2, 0]], axis=-1)
    return np.arctan2(sine, trace - 1.0)


def _runs(flags: np.ndarray, gap: int) -> Iterator[tuple[int, int]]:
    """Give the runs of true flags as (first, last + 1), those up to `gap` apart as one."""
    places = np.flatnonzero(flags)
    if places.size:
        for run in np.split(places, np.flatnonzero(np.diff(places) > gap + 1) + 1):
            yield int(run[0]), int(run[-1]) + 1


def _end(body: _Body, first: int, last: int) -> tuple[int, ...]:
    """Give the frames of a stretch to drop: those at an end of the clip, if much is left."""
    count = len(body.where)
    if (first > 0 and last < count - 1) or last - first + 1 > count - 2:
        return ()
    return tuple(range(first, last + 1))


def _edge(body: _Body, first: int, last: int) -> tuple[int, ...]:
    """Give the frames to drop around a jump: what lies between it and a near end."""
    count, near = len(body.where), round(EDGE * body.rate)
    if last <= near and last <= count - 2:
        return tuple(range(last))
    if count - 1 - first <= near and first >= 1:
        return tuple(range(first + 1, count))
    return ()


def _names(body: _Body, joints: Sequence[int] | np.ndarray) -> str:
    """Name up to three joints."""
    return _listed([body.names[joint] for joint in joints])


def _listed(names: list[str]) -> str:
    """Name the first three of many."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{', '.join(names[:3])}{more}"
