"""Pose features of the multifactor paper, and the way back to a motion.

A pose is described as in Wang, Fleet and Hertzmann (2007, section 3): joints
that turn about three axes by exponential maps (Grassia 1998), the others by
their angles; then the velocities of all of these and the velocity of the root.
On a CMU skeleton these are 43 + 43 + 3 = 89 numbers a frame.

Velocities are differences to the frame before, so that the features of the
first n frames of a clip never depend on what follows; the first frame takes
the velocity of the second. `decode` undoes `encode` exactly: it needs only
the angles, where the root started and its velocity.
"""

import re
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..errors import InputError
from .dataset import clips, make_motion, skeleton_of
from .euler import continuous_angles
from .size import body_size
from .skeleton import Skeleton

# What the paper leaves out, by the names CMU and HDM05 give these joints.
LEAVE_OUT = ("clavicle", "wrist", "hand", "finger", "thumb")


@dataclass(frozen=True)
class Layout:
    """Which joints become exponential maps and which degrees of freedom stay angles.

    maps
        Joints with three channels, the root first.
    angles
        Labels ``joint/rx`` of the remaining degrees of freedom.
    """

    maps: tuple[str, ...]
    angles: tuple[str, ...]

    @property
    def n_angles(self) -> int:
        """Number of angular features A (43 on a CMU skeleton)."""
        return 3 * len(self.maps) + len(self.angles)

    def same_features(self, other: "Layout") -> bool:
        """Whether another layout has the same features, in whatever order."""
        return set(self.maps) == set(other.maps) and set(self.angles) == set(other.angles)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of all 2 A + 3 features in their order."""
        poses = [f"{joint}/map_{axis}" for joint in self.maps for axis in "xyz"]
        poses += self.angles
        return (*poses, *(f"{label}/velocity" for label in poses), *(f"travel/{a}" for a in "xyz"))


def layout_of(skeleton: Skeleton, leave_out: tuple[str, ...] = LEAVE_OUT) -> Layout:
    """Give the layout of the features of a skeleton.

    Parameters
    ----------
    skeleton
        Any skeleton whose root turns about three axes.
    leave_out
        Joints whose name contains one of these texts (in any case) are left out.

    Raises
    ------
    InputError
        If the root does not turn about three axes.
    """
    if len(skeleton.joints[0].channels) != 3:
        raise InputError(
            f"skeleton {skeleton.name!r}",
            "its root does not turn about three axes",
            "Use a skeleton whose root has the channels rx, ry and rz",
        )
    out = re.compile("|".join(map(re.escape, leave_out)) or "(?!)", re.IGNORECASE)
    kept = [joint for joint in skeleton if not out.search(joint.name)]
    return Layout(
        tuple(joint.name for joint in kept if len(joint.channels) == 3),
        tuple(
            f"{joint.name}/{channel}"
            for joint in kept
            if len(joint.channels) < 3
            for channel in sorted(joint.channels)
        ),
    )


def encode(
    motion: xr.Dataset,
    layout: Layout,
    heading: float = 0.0,
    near: Float[np.ndarray, " angle"] | None = None,
    size: float = 1.0,
) -> Float[np.ndarray, "frame feature"]:
    """Describe every pose of one clip by its features.

    Parameters
    ----------
    motion
        Motion of one clip.
    layout
        From `layout_of`; the clip's skeleton must have its joints.
    heading
        Angle in radians about the vertical (y) axis that is taken out of the root's
        orientation and path, see `heading_of`; `decode` puts it back.
    near
        Angular features that the first frame's exponential maps lie near. Of a rotation by
        about half a turn two maps are as short, on opposite sides: clips of which some begin
        with one and some with the other would have nothing in common. None: the shortest maps.
    size
        Length, in the skeleton's unit, that the root's velocity is told in (`size.body_size`).

    Returns
    -------
    (N, 2 A + 3): angles in radians, velocities in radians a frame, root velocity
    in `size` a frame. Exponential maps run on continuously.

    Raises
    ------
    InputError
        If the skeleton lacks a joint of the layout, or the motion has several clips or
        only one frame.
    """
    clip = check_one_clip(motion)
    if motion.sizes["frame"] < 2:
        raise InputError(
            f"clip {clip!r}", "it has one frame, and no velocity", "Give at least two frames"
        )
    skeleton = skeleton_of(motion)
    _require_joints(skeleton, layout)
    turn_back = Rotation.from_rotvec([0.0, -heading, 0.0])
    columns = []
    for index, name in enumerate(layout.maps):
        channels = skeleton.joints[skeleton.index(name)].channels
        euler = motion["angle"].sel(dof=[f"{name}/{channel}" for channel in channels]).values
        # Frames in which the joint is missing have no map, and the others run on past them.
        seen = np.isfinite(euler).all(axis=1)
        turned = Rotation.from_euler(_order(channels), euler[seen])
        if name == layout.maps[0]:
            turned = turn_back * turned
        maps = np.full((len(euler), 3), np.nan)
        maps[seen] = turned.as_rotvec()
        about = None if near is None else near[3 * index : 3 * index + 3]
        columns.append(continuous(maps, about))
    columns.append(motion["angle"].sel(dof=list(layout.angles)).values)
    pose = np.concatenate(columns, axis=1)
    path = turn_back.apply(motion["root_position"].values) / size
    return np.concatenate([pose, _velocity(pose), _velocity(path)], axis=1)


def decode(
    features: Float[np.ndarray, "frame feature"],
    layout: Layout,
    skeleton: Skeleton,
    *,
    frame_rate: float,
    clip: str,
    start: Float[np.ndarray, " 3"],
    rest: dict[str, float],
    heading: float = 0.0,
    size: float = 1.0,
    labels: dict[str, str] | None = None,
    source: str = "",
    allow_missing: bool = False,
) -> xr.Dataset:
    """Make the Motion that has these features.

    Parameters
    ----------
    features
        (N, 2 A + 3) as `encode` gives them; the angles' velocities are not used.
    layout, skeleton
        As for `encode`.
    frame_rate, clip, labels, source
        As for `make_motion`.
    start
        Root position in the first frame.
    rest
        Angle in radians for each degree of freedom that is not among the features.
    heading, size
        Angle in radians to put back, and length of one, as they were given to `encode`.
    allow_missing
        Whether features may be NaN; so are angles that follow from them, and the root from there.
    """
    _require_joints(skeleton, layout)
    turn = Rotation.from_rotvec([0.0, heading, 0.0])
    angle = {dof: np.full(len(features), rest.get(dof, 0.0)) for dof in skeleton.dofs}
    for index, name in enumerate(layout.maps):
        channels = skeleton.joints[skeleton.index(name)].channels
        vector = features[:, 3 * index : 3 * index + 3]
        missing = np.isnan(vector).any(axis=1)
        turned = Rotation.from_rotvec(np.where(missing[:, None], 0.0, vector))
        if index == 0:
            turned = turn * turned
        triple = continuous_angles(turned, _order(channels))
        triple = np.where(missing[:, None], np.nan, triple)
        for channel, column in zip(channels, triple.T, strict=True):
            angle[f"{name}/{channel}"] = column
    first = 3 * len(layout.maps)
    for index, dof in enumerate(layout.angles):
        angle[dof] = features[:, first + index]
    steps = turn.apply(features[:, -3:]) * size
    steps[0] = start
    return make_motion(
        skeleton,
        np.stack([angle[dof] for dof in skeleton.dofs], axis=1),
        np.cumsum(steps, axis=0),
        frame_rate=frame_rate,
        clip=clip,
        labels=labels,
        source=source,
        allow_missing=allow_missing,
    )


def heading_of(motion: xr.Dataset, frames: int | None = None) -> float:
    """Give the heading of one clip: the angle about the vertical from +z to where it goes.

    It is the direction of travel over the first `frames` frames (all where None);
    for a clip that goes less than a fifth of the leg's length in that time it
    is the direction the root faces, averaged over those frames. Frames whose root is missing
    do not count; where all are it is zero.
    """
    part = motion.isel(frame=slice(frames))
    skeleton = skeleton_of(motion)
    root = skeleton.joints[0]
    dofs = [f"{root.name}/{channel}" for channel in root.channels]
    angles = part["angle"].sel(dof=dofs).values
    path = part["root_position"].values
    return heading_along(path, angles, root.channels, body_size(skeleton))


def heading_along(
    path: Float[np.ndarray, "frame 3"],
    angles: Float[np.ndarray, "frame 3"],
    channels: tuple[str, ...],
    size: float,
) -> float:
    """Return the heading as `heading_of`, of the root's path, angles and channels, and leg length.

    Frames with NaN do not count.
    """
    path = path[np.isfinite(path).all(axis=1)]
    travelled = path[-1] - path[0] if len(path) else np.zeros(3)
    if np.hypot(travelled[0], travelled[2]) < 0.2 * size:
        angles = angles[np.isfinite(angles).all(axis=1)]
        if not len(angles):
            return 0.0
        turned = Rotation.from_euler(_order(channels), angles)
        travelled = turned.apply([0.0, 0.0, 1.0]).mean(axis=0)
    return float(np.arctan2(travelled[0], travelled[2]))


def continuous(
    maps: Float[np.ndarray, "frame 3"], near: Float[np.ndarray, " 3"] | None = None
) -> Float[np.ndarray, "frame 3"]:
    """Let exponential maps run on, from `near` where given: of the same rotation the nearest map.

    The map v and v (1 + 2 pi k / |v|) are the same rotation for every whole k. Frames
    with NaN are passed over.
    """
    if near is not None:
        return continuous(np.vstack([near, maps]))[1:]
    out = np.array(maps, dtype=float)
    measured = np.flatnonzero(np.isfinite(out).all(axis=1))
    for last, frame in pairwise(measured):
        length = np.linalg.norm(out[frame])
        # Near no rotation every axis will do, and the one of the frame before is at hand.
        before = out[last]
        axis = out[frame] / length if length > 1e-9 else _unit(before)
        turns = np.round((before @ axis - length) / (2.0 * np.pi))
        out[frame] = (length + 2.0 * np.pi * turns) * axis
    return out


def _unit(vector: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vector)
    return vector / length if length > 0 else np.array([1.0, 0.0, 0.0])


def _velocity(values: np.ndarray) -> np.ndarray:
    difference = np.diff(values, axis=0)
    return np.concatenate([difference[:1], difference])


def _order(channels: tuple[str, ...]) -> str:
    return "".join(channel[1].upper() for channel in channels)


def _require_joints(skeleton: Skeleton, layout: Layout) -> None:
    wanted = {*layout.maps, *(dof.split("/")[0] for dof in layout.angles)}
    lacking = sorted(wanted - set(skeleton.names))
    if lacking:
        raise InputError(
            f"skeleton {skeleton.name!r}",
            f"it has no joint {', '.join(lacking)}",
            "Use clips whose skeletons name their joints alike",
        )


def check_one_clip(motion: xr.Dataset) -> str:
    """Give the name of the only clip of a Motion.

    Raises
    ------
    InputError
        If there are several.
    """
    names = clips(motion)
    if len(names) != 1:
        raise InputError(
            f"clips {', '.join(names)}", "one clip is needed", "Choose one with split(motion)[clip]"
        )
    return names[0]
