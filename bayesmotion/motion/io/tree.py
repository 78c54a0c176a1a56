"""The tree of a skeleton, laid out for computing: depth by depth, constants apart."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..skeleton import CHANNELS, Skeleton

# The shape of a tree, hashable: parent and channels of every joint. Skeletons that
# differ in bone lengths only share it, and so share one compiled graph.
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
