"""Euler angles Z, Y, X for joints that turn in a frame of their own."""

import warnings

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..errors import InputError
from .skeleton import Joint, Skeleton


def zyx_angles(
    joint: Joint, angle: Float[np.ndarray, "frame channel"]
) -> Float[np.ndarray, "frame 3"]:
    """Give the angles of Rz Ry Rx = C E C^T, without jumps between frames.

    Parameters
    ----------
    joint
        Its `axis` gives C, its `channels` the factors of E.
    angle
        Angles of the channels in radians.

    Returns
    -------
    Angles about z, y, x in radians. The same rotation has two triples of angles, up
    to whole turns; of these the one nearer to the frame before is taken.
    """
    return continuous_angles(joint_rotation(joint, angle), "ZYX")


def joint_rotation(joint: Joint, angle: Float[np.ndarray, "frame channel"]) -> Rotation:
    """Give C E C^T, the rotations of a joint against its parent; arguments as `zyx_angles`."""
    frame = Rotation.from_euler("ZYX", joint.axis[::-1])
    turn = Rotation.identity(len(angle))
    for channel, values in zip(joint.channels, angle.T, strict=True):
        turn = turn * Rotation.from_euler(channel[1].upper(), values[:, None])
    return frame * turn * frame.inv()


def continuous_angles(turn: Rotation, order: str) -> Float[np.ndarray, "frame 3"]:
    """Give the angles of a rotation about three different axes, running on along time.

    The same rotation has two triples of angles, up to whole turns; of these the one
    nearer to the frame before is taken.
    """
    return running_on(euler_angles(turn, order))


def euler_angles(turn: Rotation, order: str) -> Float[np.ndarray, "frame 3"]:
    """Give the angles of a rotation about three different axes, frame by frame.

    The middle one is between -pi / 2 and pi / 2. In gimbal lock one angle is free; SciPy sets
    it to zero, which is as good as any.
    """
    with warnings.catch_warnings():
        # What is free there is said above; any choice is the same rotation.
        warnings.filterwarnings("ignore", message="Gimbal lock")
        return turn.as_euler(order)


def running_on(triple: Float[np.ndarray, "frame 3"]) -> Float[np.ndarray, "frame 3"]:
    """Choose among equivalent triples such that each frame follows the last that is known."""
    other = np.stack([triple[:, 0] + np.pi, np.pi - triple[:, 1], triple[:, 2] + np.pi], axis=1)
    known = np.flatnonzero(np.isfinite(triple).all(axis=1))
    if not len(known):
        return triple.copy()
    options = np.stack([triple[known], other[known]])
    # From either triple of a frame to either of the next, by the nearest whole turns.
    step = options[None, :, 1:] - options[:, None, :-1]
    away = np.abs(step - 2.0 * np.pi * np.round(step / (2.0 * np.pi))).sum(axis=-1)
    taken = [0]
    for better in (away[:, 1] < away[:, 0]).T.tolist():
        taken.append(int(better[taken[-1]]))
    way = options[taken, np.arange(len(known))]
    turns = np.cumsum(np.round(np.diff(way, axis=0) / (2.0 * np.pi)), axis=0)
    way[1:] -= 2.0 * np.pi * turns
    chosen = triple.copy()
    chosen[known] = way
    return chosen


def reordered(
    angle: Float[np.ndarray, "frame dof"], own: Skeleton, other: Skeleton
) -> Float[np.ndarray, "frame other_dof"]:
    """Return the angles of a skeleton in the order of joints and of rotations of another one.

    Parameters
    ----------
    angle
        Angles in radians in the order of `own.dofs`; NaN where missing.
    own
        Has all the joints of `other`, by name.
    other
        Its joints turn about the same axes, each of three in any order.

    Returns
    -------
    Angles in the order of `other.dofs`. Where the order of a joint's rotations differs they run
    on continuously, and are NaN in frames in which one of them is missing.

    Raises
    ------
    InputError
        If `own` lacks a joint, or one turns about other axes.
    """
    columns = [angle[:, :0]]
    for joint in other:
        channels = own.joints[own.index(joint.name)].channels
        values = angle[:, [own.dofs.index(f"{joint.name}/{channel}") for channel in channels]]
        if channels != joint.channels:
            if len(channels) != 3 or len(joint.channels) != 3:
                raise InputError(
                    f"skeleton {own.name!r}",
                    f"{joint.name!r} turns about {', '.join(channels) or 'no axis'}, in "
                    f"{other.name!r} about {', '.join(joint.channels) or 'none'}",
                    "Use clips whose skeletons name their joints and degrees of freedom alike",
                )
            values = in_order(values, channels, joint.channels)
        columns.append(values)
    return np.concatenate(columns, axis=1)


def in_order(
    values: Float[np.ndarray, "frame 3"], channels: tuple[str, ...], wanted: tuple[str, ...]
) -> Float[np.ndarray, "frame 3"]:
    """Return the same rotations by angles about the same three axes in another order."""
    own, other = ("".join(one[1].upper() for one in each) for each in (channels, wanted))
    out, seen = np.full(values.shape, np.nan), np.isfinite(values).all(axis=1)
    if seen.any():
        out[seen] = continuous_angles(Rotation.from_euler(own, values[seen]), other)
    return out
