"""Bodies ready to be drawn: joints in a common frame and scale, bones and sides.

Bodies are turned so that they go (or, standing, face) forwards, and scaled to
metres (where a skeleton does not say its unit, see `metres_of`).
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ..errors import InputError
from ..motion import Skeleton, positions, skeleton_of
from ..motion.features import check_one_clip
from ..motion.sides import Side, sides

View = Literal["side", "front", "three_quarter"]

STATURE = 1.7
HEAD = 0.055  # radius of the head in statures
# Angle in radians from the direction of travel to where the viewer stands.
_VIEWER = {"side": np.pi / 2, "front": 0.0, "three_quarter": np.pi / 4}
_UNITS = (1.0, 0.01, 0.001)  # metres
_PEOPLE = (0.7, 2.3)  # metres tall


@dataclass(frozen=True)
class Body:
    """One clip seen from one side.

    Parameters
    ----------
    points
        (frame, joint, 2): to the right and up from the floor, in metres.
    depth
        (frame, joint): towards the viewer.
    bones
        (bone, 2): joints at the two ends, parent first; bones without length left out.
    sides
        For each bone "left", "right" or "centre".
    head
        Joints at the base and the top of the head, None if none is called so.
    stature
        Height in metres.
    time
        (frame,): seconds.
    forward
        (3,): horizontal direction that counts as forwards.
    made_up
        For each bone whether a model filled it in.
    """

    points: Float[np.ndarray, "frame joint 2"]
    depth: Float[np.ndarray, "frame joint"]
    bones: Int[np.ndarray, "bone 2"]
    sides: tuple[Side, ...]
    head: tuple[int, int] | None
    stature: float
    time: Float[np.ndarray, " frame"]
    forward: Float[np.ndarray, " 3"]
    made_up: tuple[bool, ...]

    @property
    def skull(self) -> Float[np.ndarray, "frame 2"]:
        """Centre of the head, whose top is where the head's bone ends (NaN without head)."""
        if self.head is None:
            return np.full((len(self.points), 2), np.nan)
        base, top = self.points[:, self.head[0]], self.points[:, self.head[1]]
        along = (top - base) / np.maximum(np.linalg.norm(top - base, axis=-1), 1e-9)[:, None]
        return top - HEAD * self.stature * along


def body_of(
    motion: xr.Dataset,
    view: View = "side",
    *,
    beside: Body | None = None,
    made_up: Collection[str] = (),
) -> Body:
    """Give the body of one clip, seen by a viewer.

    Parameters
    ----------
    motion
        Motion of one clip, y up.
    view
        From which side: "side" (it goes to the right), "front" (it comes closer) or
        "three_quarter" between the two.
    beside
        A body of the same world, whose direction forwards is to be taken.
    made_up
        Joints that a model filled in: what hangs on them is its, not the recording's.

    Raises
    ------
    InputError
        If the motion has several clips or only markers, or a frame has no known joint.
    """
    clip = check_one_clip(motion)
    if view not in _VIEWER:
        raise InputError("view", f"it is {view!r}", f"Use one of {', '.join(_VIEWER)}")
    if "angle" not in motion:
        raise InputError(
            f"clip {clip!r}",
            "only markers are known, and no bones between them",
            "Give a motion with joint angles",
        )
    skeleton = skeleton_of(motion)
    where = positions(motion).sel(joint=list(skeleton.names)).values
    unknown = np.isnan(where).any(axis=2).all(axis=1)
    if unknown.any():
        raise InputError(
            f"clip {clip!r}, frame {np.flatnonzero(unknown)[0]}",
            "no joint's position is known",
            "Leave the frame out with motion.isel(frame=...)",
        )
    where = where * metres_of(skeleton, where)
    forward = _forward(skeleton, where) if beside is None else beside.forward
    return _seen(skeleton, where, forward, _VIEWER[view], motion["time"].values, made_up)


def metres_of(skeleton: Skeleton, where: Float[np.ndarray, "frame joint 3"]) -> float:
    """Return the metres in a skeleton's unit of length.

    Files that do not say it mostly hold metres, centimetres or millimetres: a body that is as
    tall as people are in one of these is drawn at that size, and any other 1.7 tall.

    Parameters
    ----------
    skeleton
        The body.
    where
        Places of its joints in its unit, NaN where not known.
    """
    stature = stature_of(where)
    likely = [unit for unit in _UNITS if _PEOPLE[0] <= unit * stature <= _PEOPLE[1]]
    return skeleton.metres or (likely[0] if likely else STATURE / stature)


def stature_of(where: Float[np.ndarray, "frame joint 3"]) -> float:
    """Return the height of a body, which stands upright at least a tenth of the time."""
    extent = np.nanmax(where[..., 1], axis=1) - np.nanmin(where[..., 1], axis=1)
    return max(float(np.quantile(extent, 0.9)), 1e-9)


def _forward(skeleton: Skeleton, where: np.ndarray) -> np.ndarray:
    """Give the horizontal unit vector of travel, or for who stays of where they face."""
    path = where[np.isfinite(where[:, 0]).all(axis=1), 0]
    ahead = path[-1] - path[0] if len(path) else np.zeros(3)
    if np.hypot(ahead[0], ahead[2]) < 0.5 * stature_of(where):
        across = _across(skeleton, where)
        ahead = np.array([-across[2], 0.0, across[0]])
    ahead = ahead * [1.0, 0.0, 1.0]
    length = np.linalg.norm(ahead)
    return ahead / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])


def _across(skeleton: Skeleton, where: np.ndarray) -> np.ndarray:
    """Give the mean vector from the right to the left half of the body, zero without halves."""
    side = np.array(sides(skeleton.names))
    left, right = where[:, side == "left"], where[:, side == "right"]
    known = np.isfinite(left).any() and np.isfinite(right).any()
    return np.nanmean(left, axis=(0, 1)) - np.nanmean(right, axis=(0, 1)) if known else np.zeros(3)


def _seen(
    skeleton: Skeleton, where: np.ndarray, forward: np.ndarray, angle: float, time: np.ndarray,
    made_up: Collection[str],
) -> Body:  # fmt: skip
    """Look at a body from `angle` to the right of where it goes."""
    right_hand = np.array([-forward[2], 0.0, forward[0]])
    viewer = np.cos(angle) * forward + np.sin(angle) * right_hand
    to_right = np.array([viewer[2], 0.0, -viewer[0]])
    floor = np.quantile(np.nanmin(where[..., 1], axis=1), 0.05)
    points = np.stack([where @ to_right, where[..., 1] - floor], axis=-1)
    side, ends = sides(skeleton.names), bones_of(skeleton)
    bones = [int(end) for _, end in ends]
    return Body(
        points=points,
        depth=where @ viewer,
        bones=ends,
        sides=tuple(side[i] for i in bones),
        head=head_of(skeleton),
        stature=stature_of(where),
        time=time,
        forward=forward,
        made_up=tuple(_hangs_on(skeleton, i, made_up) for i in bones),
    )


def _hangs_on(skeleton: Skeleton, index: int, joints: Collection[str]) -> bool:
    """Tell whether a bone is turned by one of some joints, or by one above it."""
    above = skeleton.joints[index].parent
    while above >= 0:
        if skeleton.joints[above].name in joints:
            return True
        above = skeleton.joints[above].parent
    return False


def bones_of(skeleton: Skeleton) -> Int[np.ndarray, "bone 2"]:
    """Return the joints at the two ends of every bone that has a length, parent first."""
    ends = [
        [joint.parent, index]
        for index, joint in enumerate(skeleton)
        if index and np.linalg.norm(joint.offset) > 0
    ]
    return np.array(ends, dtype=int).reshape(-1, 2)


def head_of(skeleton: Skeleton) -> tuple[int, int] | None:
    """Return the joint called head and the end of its bone; None where none is called so."""
    for index, joint in enumerate(skeleton.joints):
        if joint.parent >= 0 and skeleton.joints[joint.parent].name.lower() == "head":
            return joint.parent, index
    return None
