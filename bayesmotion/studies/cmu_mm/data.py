"""The actions of the CMU board: joints in millimetres, cut into windows.

A pose has rotation vectors of 38 joints; the root's path is left out and its turn kept. Joints that
lie at the same place as another take what is predicted of that. With row vectors

    R_j = exp(r_j) R_parent,    x_j = o_j R_parent + x_parent.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from ..boards.data import board_file

ACTIONS = ("walking", "running", "jumping", "soccer", "basketball")
CONTEXT, HORIZON, EVERY = 10, 25, 2
# Predicted frames that errors are told at, and milliseconds.
FRAMES = {80: 2, 160: 4, 320: 8, 400: 10, 560: 14, 1000: 25}


@dataclass(frozen=True)
class Body:
    """The skeleton of the board.

    parent
        (J,) the parent of each joint, -1 for the root.
    offset_mm
        (J, 3) position from the parent at rest.
    columns
        (J, 3) columns of the rotation vectors.
    predicted
        (P,) joints that are predicted.
    copied, source
        Joints that lie where others do, and which.
    """

    parent: Int[np.ndarray, " j"]
    offset_mm: Float[np.ndarray, "j 3"]
    columns: Int[np.ndarray, "j 3"]
    predicted: Int[np.ndarray, " p"]
    copied: Int[np.ndarray, " c"]
    source: Int[np.ndarray, " c"]

    def positions_mm(self, values: Float[np.ndarray, "n v"]) -> Float[np.ndarray, "n j 3"]:
        """Return where joints are, from the root, of frames of rotation vectors."""
        turned: list[np.ndarray] = []
        placed: list[np.ndarray] = []
        for joint, parent in enumerate(self.parent):
            own = Rotation.from_rotvec(values[:, self.columns[joint]]).as_matrix()
            if parent < 0:
                turned.append(own)
                placed.append(np.tile(self.offset_mm[joint], (len(values), 1)))
            else:
                turned.append(own @ turned[parent])
                placed.append(self.offset_mm[joint] @ turned[parent] + placed[parent])
        return np.stack(placed, axis=1)


@dataclass(frozen=True)
class Windows:
    """Windows of one file or more.

    context
        (W, 10, 3 P) predicted joints in the frames given, in mm.
    future
        (W, 25, 3 P) the same in the frames to predict.
    whole
        (W, 25, J, 3) all joints in these.
    """

    context: Float[np.ndarray, "w k e"]
    future: Float[np.ndarray, "w h e"]
    whole: Float[np.ndarray, "w h j 3"]

    def every(self, step: int) -> "Windows":
        """Return every so many-th of the windows."""
        return Windows(self.context[::step], self.future[::step], self.whole[::step])


def together(parts: list[Windows]) -> Windows:
    """Return the windows of several files as those of one."""
    names = ("context", "future", "whole")
    return Windows(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def read_body(data: Path | None) -> Body:
    """Return the board's skeleton; `data` as of `boards.data.board_file`."""
    told = json.loads(board_file("cmu_mm/skeleton.json", data).read_text(encoding="utf-8"))
    predicted = np.array(told["predicted_joints"])
    return Body(
        np.array(told["parent"]),
        np.array(told["offset_mm"], dtype=float),
        np.array(told["rotation_vector_columns"]),
        predicted,
        np.array(told["copied_joints"]),
        predicted[np.array(told["copied_from"])],
    )


def read_action(split: str, action: str, data: Path | None) -> dict[str, np.ndarray]:
    """Return rotation vectors (N, V) at 25 frames a second of an action's files, by name.

    Parameters
    ----------
    split
        ``train`` or ``test``.
    action
        One of `ACTIONS`.
    data
        As of `boards.data.board_file`.
    """
    with np.load(board_file("cmu_mm/cmu_mm.npz", data)) as arrays:
        start = f"{split}/{action}/"
        clips = {n.removeprefix(start): arrays[n] for n in arrays.files if n.startswith(start)}
    made = {}
    for name, values in clips.items():
        made[name] = values[::EVERY].astype(float)
        made[name][:, :3] = 0.0
    return made


def windows_of(body: Body, values: Float[np.ndarray, "n v"]) -> Windows:
    """Return all windows of a file's frames."""
    joints = body.positions_mm(values)
    entries = joints[:, body.predicted].reshape(len(joints), -1)
    starts = range(len(joints) - CONTEXT - HORIZON + 1)
    return Windows(
        np.stack([entries[i : i + CONTEXT] for i in starts]),
        np.stack([entries[i + CONTEXT : i + CONTEXT + HORIZON] for i in starts]),
        np.stack([joints[i + CONTEXT : i + CONTEXT + HORIZON] for i in starts]),
    )


def errors_mm(
    body: Body, windows: Windows, mean: Float[np.ndarray, "w h e"]
) -> Float[np.ndarray, "w t"]:
    """Return the mean distance of joints at the frames of `FRAMES`, window by window."""
    at = np.array([*FRAMES.values()]) - 1
    made = windows.whole[:, at].copy()
    made[:, :, body.predicted] = mean[:, at].reshape(len(mean), len(at), -1, 3)
    made[:, :, body.copied] = made[:, :, body.source]
    return np.linalg.norm(made - windows.whole[:, at], axis=-1).mean(axis=-1)
