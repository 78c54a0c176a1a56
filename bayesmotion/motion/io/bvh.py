"""Reading and writing BVH files, through pybvh."""

import re
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pybvh
import xarray as xr
from jaxtyping import Float
from pybvh.bvhnode import BvhEndSite, BvhJoint, BvhNode, BvhRoot

from ...errors import InputError
from ...files import BVH, replacing
from ..dataset import add_history, make_motion, skeleton_of
from ..euler import zyx_angles
from ..joining import check_exportable
from ..skeleton import CHANNELS, Joint, Skeleton
from .text import Line, read_lines


def read_bvh(
    path: str | Path,
    *,
    clip: str | None = None,
    labels: Mapping[str, str] | None = None,
    skip_first_frame: bool = False,
) -> xr.Dataset:
    """Read a motion from a BVH file.

    Parameters
    ----------
    path
        The file. Its stem becomes the skeleton's name; BVH does not say the length unit.
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

    Raises
    ------
    InputError
        If the file is missing, broken, or has joints that move along or have other than
        three rotations; file and, where known, line are named.
    """
    path = Path(path)
    lines = read_lines(path)
    content = _parse(path, lines)
    skeleton = _skeleton(path.stem, content)
    angle = content.joint_angles.reshape(content.frame_count, -1)
    _check_values(lines, np.hstack([content.root_pos, angle]))
    start = int(skip_first_frame)
    if content.frame_count - start < 2:
        raise InputError(
            path, f"there are {content.frame_count} frames", "Give a motion of at least two frames"
        )
    motion = make_motion(
        skeleton,
        angle[start:],
        content.root_pos[start:],
        frame_rate=_rate(content.frame_time),
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
        (`files.Kind.check`), or the skeleton has only one joint.
    """
    BVH.check(path)
    check_exportable(motion, "BVH")
    skeleton = skeleton_of(motion)
    if len(skeleton) < 2:
        raise InputError(path, "a BVH file has at least two joints", "Give a whole skeleton")
    nodes, columns = _nodes(skeleton, motion["angle"].sel(dof=list(skeleton.dofs)).values)
    content = pybvh.Bvh(
        nodes=nodes,
        # The position channels of a BVH root stand for its offset, too.
        root_pos=motion["root_position"].values + np.array(skeleton.joints[0].offset),
        joint_angles=np.stack(columns, axis=1),
        frame_time=1.0 / (motion.attrs["frame_rate"] if frame_rate is None else frame_rate),
        world_up="+y",
    )
    with replacing(path) as temporary:
        pybvh.write_bvh_file(content, temporary)


def _parse(path: Path, lines: list[Line]) -> pybvh.Bvh:
    """Let pybvh read the file, and tell its complaints in our way."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            return pybvh.read_bvh_file(path, world_up="+y")
    except (ValueError, IndexError, UserWarning) as error:
        raise InputError(
            _place(path, lines, str(error)),
            f"pybvh cannot read it ({error})",
            "Give a BVH file whose root alone moves along, with three rotations a joint",
        ) from error


def _place(path: Path, lines: list[Line], message: str) -> str:
    """Find out from a message which line it is about."""
    if found := re.search(r"at line (\d+)", message):
        return f"{path}:{found[1]}"
    frames = _frame_lines(lines)
    if (found := re.search(r"at row (\d+)", message)) and int(found[1]) < len(frames):
        return f"{path}:{frames[int(found[1])].number}"
    return str(path)


def _frame_lines(lines: list[Line]) -> list[Line]:
    """Give the lines that hold one frame each."""
    heads = [index for index, line in enumerate(lines) if line.text.startswith("Frame Time")]
    return [line for line in lines[heads[0] + 1 :] if line.text] if heads else []


def _check_values(lines: list[Line], values: Float[np.ndarray, "frame channel"]) -> None:
    """Refuse values that are not finite."""
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if bad.size:
        raise _frame_lines(lines)[bad[0]].error(
            "a value is not a finite number", "Correct it or leave the frame out"
        )


def _rate(frame_time: float) -> float:
    """Give the frame rate, exactly where it is a whole number."""
    rate = 1.0 / frame_time
    return float(round(rate)) if abs(rate - round(rate)) < 1e-6 else rate


def _skeleton(name: str, content: pybvh.Bvh) -> Skeleton:
    """Turn the nodes of pybvh into joints."""
    places = {id(node): index for index, node in enumerate(content.nodes)}
    joints = []
    for node in content.nodes:
        parent = -1 if node.parent is None else places[id(node.parent)]
        if not isinstance(node, BvhJoint):
            joint = Joint(f"{content.nodes[parent].name}_end", parent, _triple(node.offset))
        else:
            channels = tuple(f"r{axis.lower()}" for axis in node.rot_channels)
            # The position channels of the root stand for its offset, too.
            offset = _triple(node.offset) if parent >= 0 else (0.0, 0.0, 0.0)
            joint = Joint(node.name, parent, offset, channels=channels)
        joints.append(joint)
    return Skeleton(name, tuple(joints))


def _triple(offset: np.ndarray) -> tuple[float, float, float]:
    """Give three plain numbers."""
    x, y, z = offset.tolist()
    return (x, y, z)


def _nodes(
    skeleton: Skeleton, angle: Float[np.ndarray, "frame dof"]
) -> tuple[list[BvhNode], list[np.ndarray]]:
    """Turn joints into pybvh's nodes, depth first, with the angles (frame, 3) of each."""
    nodes: list[BvhNode] = []
    columns: list[np.ndarray] = []

    def place(node: BvhNode, parent: BvhJoint | None) -> None:
        nodes.append(node)
        if parent is not None:
            parent.children = [*parent.children, node]

    def add(index: int, parent: BvhJoint | None) -> None:
        joint = skeleton.joints[index]
        if _is_end(skeleton, index):
            place(BvhEndSite(joint.name, list(joint.offset), parent), parent)
            return
        names, turned = _channels(skeleton, joint, angle)
        columns.append(turned)
        if parent is None:
            node: BvhJoint = BvhRoot(joint.name, rot_channels=names)
        else:
            node = BvhJoint(joint.name, list(joint.offset), names, [], parent)
        place(node, parent)
        for child, below in enumerate(skeleton):
            if below.parent == index:
                add(child, node)

    add(0, None)
    return nodes, columns


def _is_end(skeleton: Skeleton, index: int) -> bool:
    """Say whether a joint can be an end site: a leaf that does not turn, named like one."""
    joint = skeleton.joints[index]
    if joint.channels or any(other.parent == index for other in skeleton):
        return False
    return index > 0 and joint.name == f"{skeleton.joints[joint.parent].name}_end"


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
