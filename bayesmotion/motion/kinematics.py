"""Forward kinematics: from joint angles to joint positions.

The tree is worked off level by level (all joints of one depth at once), so there are as many
steps as the tree is deep, not as it has joints. The steps are the same for NumPy arrays, which
recordings are (`poses`, `positions`), and for JAX's (`differentiable`).
"""

from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from jaxtyping import Float

from .dataset import SPACE, skeleton_of
from .joining import split
from .skeleton import CHANNELS, Skeleton

if TYPE_CHECKING:
    from jax import Array

    Numbers = np.ndarray | Array
else:
    # Reading files does not import JAX.
    Numbers = object

# Frames done at once by `poses`: rotations of all joints of so many are small enough for caches.
_CHUNK = 512

# The shape of a tree, hashable: parent and channels of every joint. Skeletons that
# differ in bone lengths only share it, and what is compiled for it.
Tree = tuple[tuple[int, tuple[str, ...]], ...]

# K of the three coordinate axes: K v = e x v.
CROSS = np.cross(np.eye(3)[:, None, :], np.eye(3)[None, :, :]).swapaxes(-1, -2)


@dataclass(frozen=True)
class Level:
    """The joints of one depth, and the places of their parents within the depth above."""

    joints: np.ndarray
    parents: np.ndarray


@dataclass(frozen=True)
class Layout:
    """What follows from the shape of the tree."""

    columns: np.ndarray  # (joint, 3): which dof turns as the first, second, third factor
    axes: np.ndarray  # (joint, 3): about which axis
    levels: tuple[Level, ...]
    order: np.ndarray  # place of every joint in the levels put one after the other


def positions(motion: xr.Dataset) -> xr.DataArray:
    """Give the joint positions of a Motion.

    Parameters
    ----------
    motion
        Any Motion; where it holds marker positions already, these are given back.

    Returns
    -------
    Array (frame, joint, space) in the unit of each clip's skeleton, NaN for the
    joints that a clip's skeleton does not have.
    """
    if "position" in motion:
        return motion["position"]
    parts = [_positions_of_clip(part) for part in split(motion).values()]
    names = list(dict.fromkeys(name for part in parts for name in part["joint"].values.tolist()))
    joined = np.concatenate([part.reindex(joint=names).values for part in parts])
    # Clips need not lie in one piece along `frame`: put every frame where it belongs.
    owners = motion["clip"].values
    rows = np.concatenate([np.flatnonzero(owners == part.name) for part in parts])
    result = np.empty_like(joined)
    result[rows] = joined
    return xr.DataArray(
        result,
        dims=("frame", "joint", "space"),
        coords={**_frame_coords(motion), "joint": np.array(names), "space": np.array(SPACE)},
        name="position",
    )


def _positions_of_clip(part: xr.Dataset) -> xr.DataArray:
    """Give the positions of a one-clip Motion, named after the clip."""
    skeleton = skeleton_of(part)
    values, _ = poses(skeleton, part["angle"].values, part["root_position"].values)
    return xr.DataArray(
        values,
        dims=("frame", "joint", "space"),
        coords={"joint": np.array(skeleton.names)},
        name=str(part["clip"].values[0]),
    )


def _frame_coords(motion: xr.Dataset) -> dict:
    """Choose the coordinates that lie on `frame`."""
    return {name: value for name, value in motion.coords.items() if value.dims == ("frame",)}


def poses(
    skeleton: Skeleton,
    angle: Float[np.ndarray, "frame dof"],
    root_position: Float[np.ndarray, "frame 3"],
) -> tuple[Float[np.ndarray, "frame joint 3"], Float[np.ndarray, "frame joint 3 3"]]:
    """Give positions and rotations of many frames as NumPy arrays.

    Parameters
    ----------
    skeleton, angle, root_position
        As for `differentiable.forward`.

    Returns
    -------
    What `forward` and `rotations` give.
    """
    tree, frames, offsets = parts_of(skeleton)
    where = np.empty((len(angle), len(skeleton), 3))
    turned = np.empty((len(angle), len(skeleton), 3, 3))
    for start in range(0, len(angle), _CHUNK):
        rows = slice(start, start + _CHUNK)
        where[rows], turned[rows] = poses_of(
            np, tree, frames, offsets, angle[rows], root_position[rows]
        )
    return where, turned


def rest_places(skeleton: Skeleton) -> Float[np.ndarray, "joint 3"]:
    """Give the places of the joints where all angles are zero, in the skeleton's unit."""
    where = np.zeros((len(skeleton), 3))
    for index, joint in enumerate(skeleton):
        where[index] = joint.offset + where[joint.parent] if index else joint.offset
    return where


def rotations_of(xp: ModuleType, tree: Tree, frames: Numbers, angle: Numbers) -> Numbers:
    """Give the global rotations: each level is its parents' times its own.

    Parameters
    ----------
    xp
        NumPy, or JAX's likeness of it: whose arrays are taken and given.
    tree, frames
        As of `parts_of`.
    angle
        (..., dof) in radians.

    Returns
    -------
    Rotation matrices (..., joint, 3, 3).
    """
    layout = layout_of(tree)
    local = _local_rotations(xp, layout, frames, angle)
    levels = [local[..., layout.levels[0].joints, :, :]]
    for level in layout.levels[1:]:
        levels.append(levels[-1][..., level.parents, :, :] @ local[..., level.joints, :, :])
    return xp.concatenate(levels, axis=-3)[..., layout.order, :, :]


def poses_of(
    xp: ModuleType,
    tree: Tree,
    frames: Numbers,
    offsets: Numbers,
    angle: Numbers,
    root: Numbers,
) -> tuple[Numbers, Numbers]:
    """Give positions and rotations: each level is its parents' plus its turned offsets.

    Parameters
    ----------
    xp, tree, frames, angle
        As of `rotations_of`.
    offsets
        (joint, 3) of every joint from its parent.
    root
        (..., 3) positions of the root.

    Returns
    -------
    Positions (..., joint, 3) and rotation matrices (..., joint, 3, 3).
    """
    turned = rotations_of(xp, tree, frames, angle)
    parents = np.array([max(parent, 0) for parent, _ in tree])
    bones = xp.einsum("...jab,jb->...ja", turned[..., parents, :, :], offsets)
    layout = layout_of(tree)
    levels = [(root + offsets[0])[..., None, :]]
    for level in layout.levels[1:]:
        levels.append(levels[-1][..., level.parents, :] + bones[..., level.joints, :])
    return xp.concatenate(levels, axis=-2)[..., layout.order, :], turned


def _local_rotations(xp: ModuleType, layout: Layout, frames: Numbers, angle: Numbers) -> Numbers:
    """Give C E C^T of every joint."""
    # One more column, always zero, stands for the channels a joint does not have.
    padded = xp.concatenate([angle, xp.zeros((*angle.shape[:-1], 1), angle.dtype)], axis=-1)
    factors = [
        _elementary(xp, padded[..., layout.columns[:, place]], layout.axes[:, place])
        for place in range(3)
    ]
    frames = xp.asarray(frames)
    return frames @ (factors[0] @ factors[1] @ factors[2]) @ frames.swapaxes(-1, -2)


def _elementary(xp: ModuleType, angle: Numbers, axes: np.ndarray) -> Numbers:
    """Give rotations about coordinate axes: I + sin(a) K + (1 - cos(a)) K^2."""
    across = CROSS[axes]
    sine, cosine = xp.sin(angle)[..., None, None], xp.cos(angle)[..., None, None]
    return xp.eye(3) + sine * across + (1.0 - cosine) * (across @ across)


@lru_cache(maxsize=64)
def parts_of(skeleton: Skeleton) -> tuple[Tree, np.ndarray, np.ndarray]:
    """Take a skeleton apart: shape of the tree, frames C (joint, 3, 3), offsets (joint, 3)."""
    tree = tuple((joint.parent, joint.channels) for joint in skeleton)
    frames = np.array([_frame(joint.axis) for joint in skeleton])
    return tree, frames, np.array([joint.offset for joint in skeleton], dtype=float)


@lru_cache(maxsize=64)
def layout_of(tree: Tree) -> Layout:
    """Lay the tree out by depth."""
    depth: list[int] = []
    for parent, _ in tree:
        depth.append(0 if parent < 0 else depth[parent] + 1)
    groups = [[j for j, d in enumerate(depth) if d == level] for level in range(max(depth) + 1)]
    levels = tuple(
        Level(np.array(group), np.array([above.index(tree[j][0]) if above else 0 for j in group]))
        for above, group in zip([[], *groups], groups, strict=False)
    )
    columns, axes = _columns(tree)
    order = np.argsort(np.concatenate([level.joints for level in levels]))
    return Layout(columns, axes, levels, order)


def _columns(tree: Tree) -> tuple[np.ndarray, np.ndarray]:
    """Say for each joint which columns of the angles are its factors, and their axes."""
    columns = np.full((len(tree), 3), sum(len(channels) for _, channels in tree))
    axes = np.zeros((len(tree), 3), dtype=int)
    at = 0
    for j, (_, channels) in enumerate(tree):
        for place, channel in enumerate(channels):
            columns[j, place], axes[j, place] = at, CHANNELS.index(channel)
            at += 1
    return columns, axes


def _frame(axis: tuple[float, float, float]) -> np.ndarray:
    """Give C = Rz Ry Rx of the angles `axis`."""
    turn = np.eye(3)
    for angle, across in zip(axis, CROSS, strict=True):
        one = np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * (across @ across)
        turn = one @ turn
    return turn
