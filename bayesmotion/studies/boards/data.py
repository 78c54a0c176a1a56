"""The boards' data, as packaged by others; nothing of it is part of this package.

All motions are CMU's (mocap.cs.cmu.edu). They lie in a folder ``benchmarks`` of the recordings:

    cmu35/mocap35.mat      uncbiag/neuro_shooting (Apache-2.0), after Yildiz et al. 2019
    gpode/mocap<..>.npz    hegdepashupati/gaussian-process-odes (MIT), of Hegde et al. 2022
    cmu_mm/                chaneyddtt/Convolutional-Sequence-to-Sequence-Model-... (MIT)
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from ...errors import InputError
from ...motion.datasets.fetching import folders
from .harness import Board

FRAME_RATE = 120.0
CMU35_CONTEXT = 3


def board_file(name: str, data: Path | None) -> Path:
    """Return where a file of the boards lies.

    Parameters
    ----------
    name
        Its path in the folder ``benchmarks``.
    data
        Folder that holds ``benchmarks/``; where None as in ``$BAYESMOTION_DATA``.

    Raises
    ------
    InputError
        If it is in no folder.
    """
    places = folders("benchmarks", None if data is None else data / "benchmarks")
    for place in places:
        if (place / name).is_file():
            return place / name
    raise InputError(
        f"benchmarks/{name}",
        f"it is not in {', '.join(str(place) for place in places)}",
        "Put it there from the repository that packages it, or name the folder that has it",
    )


def read_cmu35(data: Path | None, *, validation: bool = True) -> Board:
    """Return the board of subject 35's walks: 3 frames given, 297 predicted, in degrees.

    Parameters
    ----------
    data
        As of `board_file`.
    validation
        Whether the three validation clips are among the training clips, or left out.
    """
    arrays = loadmat(board_file("cmu35/mocap35.mat", data))
    train = {f"train {i + 1}": y for i, y in enumerate(arrays["Xtr"])}
    if validation:
        train |= {f"validation {i + 1}": y for i, y in enumerate(arrays["Xval"])}
    test = {f"test {i + 1}": y for i, y in enumerate(arrays["Xtest"])}
    return Board("cmu35", _floats(train), _floats(test), CMU35_CONTEXT, FRAME_RATE)


def read_gpode(subject: str, data: Path | None, *, validation: bool = True) -> Board:
    """Return the board of a subject ("09", "35" or "39"): the first pose given, in degrees.

    Parameters
    ----------
    subject
        Which.
    data
        As of `board_file`.
    validation
        Whether the validation clips are among the training clips, or left out.
    """
    with np.load(board_file(f"gpode/mocap{subject}.npz", data)) as arrays:
        train = {f"train {i + 1}": y for i, y in enumerate(arrays["train"])}
        if validation:
            train |= {f"validation {i + 1}": y for i, y in enumerate(arrays["validation"])}
        test = {f"test {i + 1}": y for i, y in enumerate(arrays["test"])}
    return Board(f"gpode{subject}", _floats(train), _floats(test), 1, FRAME_RATE)


def _floats(clips: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: np.asarray(clip, dtype=float) for name, clip in clips.items()}


def read_board(name: str, data: Path | None) -> Board:
    """Return a board by its name.

    Raises
    ------
    InputError
        If there is no such board.
    """
    if name not in BOARDS:
        raise InputError(name, "there is no such board", f"Use {', '.join(BOARDS)}")
    return BOARDS[name](data)


GPODE_SUBJECTS = ("09", "35", "39")
BOARDS: dict[str, Callable[[Path | None], Board]] = {"cmu35": read_cmu35}
BOARDS |= {f"gpode{subject}": partial(read_gpode, subject) for subject in GPODE_SUBJECTS}
