"""Bones from the channels of a BVH file, whichever joints have position channels.

The position channels of a joint stand for its offset. What the Skeleton can hold is one root
that moves and bones that keep their lengths, so here positions that stay the same become
offsets, and where only one joint below a still root moves (the hips below a reference
node), that joint becomes the root.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...errors import InputError, MotionWarning
from ..euler import continuous_angles, joint_rotation
from ..skeleton import Joint
from .bvh_nodes import Content, Node

# Of the longest bone: what positions may wander, and still are those of one bone.
_STILL = 0.01


@dataclass(frozen=True)
class Bones:
    """What becomes of the nodes: angles in radians, lengths in the file's unit.

    Parameters
    ----------
    kept
        Places of the nodes that stay, the root first.
    parent
        Of every node, kept or not.
    offset, channels
        Of the nodes that stay.
    angle
        Angles, joint by joint in the order of their channels.
    root
        Path of the root.
    """

    kept: list[int]
    parent: list[int]
    offset: list[np.ndarray]
    channels: list[tuple[str, ...]]
    angle: Float[np.ndarray, "frame dof"]
    root: Float[np.ndarray, "frame 3"]


def bones_of(content: Content) -> Bones:
    """Work out bones, angles and the path of the root.

    Raises
    ------
    InputError
        If a bone changes its length; its line is named.
    """
    nodes = content.nodes
    paths, angles = _taken_apart(content)
    length = [np.median(path, axis=0) for path in paths]
    _take_offsets(nodes, length, paths)
    longest = max((float(np.linalg.norm(bone)) for bone in length[1:]), default=0.0)
    wander = [
        float(np.linalg.norm(path - bone, axis=1).max())
        for path, bone in zip(paths, length, strict=True)
    ]
    moving = [i for i in range(1, len(nodes)) if wander[i] > _STILL * longest]
    lead = moving[0] if moving and _can_lead(nodes, moving[0], paths, angles) else 0
    for index in moving:
        if index != lead:
            raise _changing(nodes[index], paths[index])
    kept = [i for i in range(len(nodes)) if i == lead or lead in _above(nodes, i)]
    channels = [_rotations(nodes[i]) for i in kept]
    root, turned = paths[0], angles[lead]
    if lead:
        root, turned, channels[0] = _led(nodes, lead, paths, angles)
    return Bones(
        kept,
        [node.parent for node in nodes],
        # The path of the root stands for its offset, too.
        [np.zeros(3), *(length[i] for i in kept[1:])],
        channels,
        np.hstack([turned, *(angles[i] for i in kept[1:])]),
        root,
    )


def _rotations(node: Node) -> tuple[str, ...]:
    """Give the rotations of a node as the channels of a joint: ``("rz", "rx", "ry")``."""
    return tuple(f"r{name[0]}" for name in node.channels if name.endswith("rotation"))


def _taken_apart(content: Content) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Give every node's path relative to its parent (frame, 3), and its angles in radians."""
    paths, angles, at = [], [], 0
    for node in content.nodes:
        columns = content.values[:, at : at + len(node.channels)]
        at += len(node.channels)
        path = np.tile(node.offset, (len(columns), 1))
        for name, column in zip(node.channels, columns.T, strict=True):
            if name.endswith("position"):
                path[:, "xyz".index(name[0])] = column
        turns = [name.endswith("rotation") for name in node.channels]
        paths.append(path)
        angles.append(np.radians(columns[:, turns]))
    return paths, angles


def _take_offsets(nodes: list[Node], length: list[np.ndarray], paths: list[np.ndarray]) -> None:
    """Take the offset where positions are all zero: the file counts them from there."""
    zero = [
        i
        for i in range(1, len(nodes))
        if any(nodes[i].offset) and not paths[i].any()
    ]  # fmt: skip
    if not zero:
        return
    for index in zero:
        length[index] = np.array(nodes[index].offset)
        paths[index] = np.tile(length[index], (len(paths[index]), 1))
    line = nodes[zero[0]].line
    warnings.warn(
        f"{line.path}:{line.number}: the positions of {len(zero)} joints "
        f"({nodes[zero[0]].name} first) are zero throughout; their OFFSET is taken for the bone",
        MotionWarning,
        stacklevel=4,
    )


def _above(nodes: list[Node], index: int) -> list[int]:
    """Give the nodes above one, the root last."""
    above = []
    while (index := nodes[index].parent) >= 0:
        above.append(index)
    return above


def _can_lead(
    nodes: list[Node], index: int, paths: list[np.ndarray], angles: list[np.ndarray]
) -> bool:
    """Say whether a joint can be the root instead of what is above it.

    Nothing else may hang from there, and it must be still, or the joint must be where the
    body branches (hips below a root that moves along the floor), not one that slides.
    """
    above = _above(nodes, index)
    for i, node in enumerate(nodes):
        part = i in above or i == index or index in _above(nodes, i)
        if not part and not node.end:
            return False
    still = not any(np.ptp(values[i], axis=0).any() for i in above for values in (paths, angles))
    return still or sum(node.parent == index and not node.end for node in nodes) > 1


def _led(
    nodes: list[Node], lead: int, paths: list[np.ndarray], angles: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Give path, angles and channels in the world of the joint that becomes the root."""
    turn, where = Rotation.identity(len(paths[0])), np.zeros_like(paths[0])
    above = _above(nodes, lead)[::-1]
    for index in above:
        where = where + turn.apply(paths[index])
        turn = turn * _turned(nodes[index], angles[index])
    where = where + turn.apply(paths[lead])
    channels = _rotations(nodes[lead])
    if not any(angles[index].any() for index in above):
        return where, angles[lead], channels
    whole = (*channels, *(name for name in ("rz", "ry", "rx") if name not in channels))
    order = "".join(name[1] for name in whole).upper()
    return where, continuous_angles(turn * _turned(nodes[lead], angles[lead]), order), whole


def _turned(node: Node, angle: Float[np.ndarray, "frame channel"]) -> Rotation:
    """Give the rotations of a node against its parent."""
    joint = Joint(node.name, -1, (0.0, 0.0, 0.0), channels=_rotations(node))
    return joint_rotation(joint, angle)


def _changing(node: Node, path: Float[np.ndarray, "frame 3"]) -> InputError:
    """Make the error for a bone that changes its length or slides."""
    length = np.linalg.norm(path, axis=1)
    frame = int(np.argmax(np.linalg.norm(path - path[0], axis=1)))
    change = abs(length[frame] - length[0])
    does = (
        f"changes its length by {change:.3g}"
        if change > 0
        else f"moves by {np.linalg.norm(path[frame] - path[0]):.3g} against its parent"
    )
    return node.line.error(
        f"{node.name!r} {does} in frame {frame} (counted from 0)",
        "Export it with rigid bones, the root alone moving along",
    )
