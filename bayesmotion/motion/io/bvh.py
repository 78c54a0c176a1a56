"""Reading and writing BVH files."""

import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...errors import InputError, MotionWarning
from ...files import BVH, replacing
from ..dataset import add_history, make_motion, skeleton_of
from ..euler import zyx_angles
from ..joining import check_exportable
from ..skeleton import CHANNELS, Joint, Skeleton
from .bvh_nodes import Node, names_of, read_content
from .bvh_paths import Bones, bones_of
from .text import Line, read_lines


def read_bvh(
    path: str | Path,
    *,
    frame_rate: float | None = None,
    clip: str | None = None,
    labels: Mapping[str, str] | None = None,
    skip_first_frame: bool = False,
) -> xr.Dataset:
    """Read a motion from a BVH file.

    Position channels that stay the same are the bone, as most programs write them beside or
    instead of the offset; a root that stays still above the moving hips is taken off.

    Parameters
    ----------
    path
        The file. Its stem becomes the skeleton's name; BVH does not say the length unit.
    frame_rate
        Frames a second, where the file's frame time is rounded or wrong.
    clip
        Name of the clip, by default the file's stem.
    labels
        What is known of the clip, for example its subject.
    skip_first_frame
        Leave out the first frame, which is a T-pose in the BVH release of CMU.

    Returns
    -------
    Motion of one clip, in radians and the file's length unit. An end site becomes the
    joint ``<parent>_end``.

    Warns
    -----
    MotionWarning
        Of one frame more or less than declared, names that stand twice, and position
        channels that are zero where the offset is not.

    Raises
    ------
    InputError
        If the file is missing, broken, or has bones that change their length; file and,
        where known, line are named.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> motion = bm.read("walk.bvh", frame_rate=30.0)  # doctest: +SKIP
    """
    path = Path(path)
    content = read_content(path, read_lines(path), frame_rate)
    names = _named(content.nodes)
    bones = bones_of(content)
    start = int(skip_first_frame)
    if len(bones.angle) <= start:
        raise InputError(path, "there is only one frame", "Read it without skip_first_frame")
    motion = make_motion(
        _skeleton(path.stem, names, bones),
        bones.angle[start:],
        bones.root[start:],
        frame_rate=content.rate,
        clip=path.stem if clip is None else clip,
        labels=labels,
        source=path.name,
    )
    return add_history(motion, "read_bvh: without the first frame") if start else motion


def write_bvh(motion: xr.Dataset, path: str | Path, *, frame_rate: float | None = None) -> None:
    """Write a Motion of one clip as BVH, in degrees with six decimals.

    Joints that turn in a frame of their own (ASF bones) are written with the angles
    Z, Y, X of the same rotation, chosen such that they run on from frame to frame.

    Parameters
    ----------
    motion
        One clip without missing values.
    path
        File to write, ending in .bvh; it is the old one or the new one.
    frame_rate
        Frames a second to write, by default those of the Motion.

    Raises
    ------
    InputError
        If there are several clips, NaN or only markers, the path cannot be written
        (`files.Kind.check`), or BVH cannot hold a joint's name.
    """
    BVH.check(path)
    check_exportable(motion, "BVH")
    skeleton = skeleton_of(motion)
    for name in skeleton.names:
        plain = name.isprintable() and name == " ".join(name.split())
        if not (name and plain) or set(name) & set("{}"):
            raise InputError(
                f"joint {name!r}", "BVH cannot hold this name", "Rename it, without braces"
            )
    rate = motion.attrs["frame_rate"] if frame_rate is None else frame_rate
    lines, columns = _written(skeleton, motion["angle"].sel(dof=list(skeleton.dofs)).values)
    # The position channels of a BVH root stand for its offset, too.
    root = motion["root_position"].values + np.array(skeleton.joints[0].offset)
    lines += ["MOTION", f"Frames: {len(root)}", f"Frame Time: {1.0 / rate:.12f}"]
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")
        np.savetxt(file, np.hstack([root, *(np.degrees(each) for each in columns)]), fmt="%.6f")


def _named(nodes: list[Node]) -> list[str]:
    """Give the names of the nodes, and tell which had to change."""
    names = names_of(nodes)
    for node, name in zip(nodes, names, strict=True):
        if not node.end and node.name != name:
            warnings.warn(
                f"{node.line.path}:{node.line.number}: a second joint is called {node.name!r}; "
                f"it is now {name!r}",
                MotionWarning,
                stacklevel=3,
            )
    return names


def _skeleton(name: str, names: list[str], bones: Bones) -> Skeleton:
    """Turn the nodes below the root that leads into joints."""
    place = {node: index for index, node in enumerate(bones.kept)}
    joints = []
    for node, offset, channels in zip(bones.kept, bones.offset, bones.channels, strict=True):
        parent = place.get(bones.parent[node], -1)
        x, y, z = offset.tolist()
        joints.append(Joint(names[node], parent, (x, y, z), channels=channels))
    return Skeleton(name, tuple(joints))


def _written(
    skeleton: Skeleton, angle: Float[np.ndarray, "frame dof"]
) -> tuple[list[str], list[np.ndarray]]:
    """Give the lines of the hierarchy, and the angles (frame, 3) of each joint in their order."""
    below: dict[int, list[int]] = {index: [] for index in range(-1, len(skeleton))}
    for index, joint in enumerate(skeleton):
        below[joint.parent].append(index)
    ends = _ends(skeleton, below)
    lines, columns = ["HIERARCHY"], []
    waiting: list[tuple[int, int, bool]] = [(0, 0, True)]  # joint, depth, whether it opens
    while waiting:
        index, depth, opens = waiting.pop()
        joint, tab = skeleton.joints[index], "\t" * depth
        if not opens:
            lines.append(f"{tab}}}")
            continue
        end = index in ends
        kind = "End Site" if end else f"{'JOINT' if depth else 'ROOT'} {joint.name}"
        x, y, z = joint.offset
        lines += [f"{tab}{kind}", f"{tab}{{", f"{tab}\tOFFSET {x:.6f} {y:.6f} {z:.6f}"]
        if not end:
            names, turned = _channels(skeleton, joint, angle)
            columns.append(turned)
            moved = "" if depth else "Xposition Yposition Zposition "
            words = " ".join(f"{name}rotation" for name in names)
            lines.append(f"{tab}\tCHANNELS {3 if depth else 6} {moved}{words}")
        waiting.append((index, depth, False))
        waiting += [(child, depth + 1, True) for child in reversed(below[index])]
    return lines, columns


def _ends(skeleton: Skeleton, below: Mapping[int, list[int]]) -> set[int]:
    """Choose the leaves that do not turn and that a reader calls as they are called here."""
    ends = {i for i, j in enumerate(skeleton) if i and not j.channels and not below[i]}
    line = Line(Path(), 0, "")
    while True:
        nodes = [Node(line, j.name, j.parent, i in ends) for i, j in enumerate(skeleton)]
        others = {i for i, name in enumerate(names_of(nodes)) if name != skeleton.names[i]}
        if not others:
            return ends
        ends -= others


def _channels(
    skeleton: Skeleton, joint: Joint, angle: Float[np.ndarray, "frame dof"]
) -> tuple[list[str], Float[np.ndarray, "frame 3"]]:
    """Give the three rotation channels of a joint and their angles."""
    own = [skeleton.dofs.index(f"{joint.name}/{channel}") for channel in joint.channels]
    if any(joint.axis):
        return ["Z", "Y", "X"], zyx_angles(joint, angle[:, own])
    # A channel that the joint lacks is written as one that stays at zero.
    more = [channel for channel in CHANNELS[::-1] if channel not in joint.channels]
    names = [channel[1].upper() for channel in (*joint.channels, *more)]
    return names, np.hstack([angle[:, own], np.zeros((len(angle), len(more)))])
