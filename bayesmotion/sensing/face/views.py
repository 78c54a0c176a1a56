"""Recordings of speech made into views of sound and face.

A recording is a sound (or video) file and, beside it, the tracks of its face: a csv file of
the same name with a line of column names and then one line a video frame. A data set of views
keeps how the sound was described (`frame_rate`, `n_coefficients`), so that new sound is
described alike.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...errors import InputError
from ...motion.io.text import number, read_lines
from ..audio.cepstra import mfcc, read_audio

COEFFICIENTS = 20
FRAME_RATE = 25.0


def views_of(
    sound: Mapping[str, Float[np.ndarray, "_ a"]],
    face: Mapping[str, Float[np.ndarray, "_ d"]],
    coordinates: Sequence[str],
    *,
    frame_rate: float = FRAME_RATE,
) -> xr.Dataset:
    """Join clips to a data set of the views ``audio`` and ``face``.

    Parameters
    ----------
    sound, face
        Features of every clip by its name.
    coordinates
        Names of the face's columns.
    frame_rate
        Frames a second.

    Raises
    ------
    InputError
        If there is no clip, or sound and face of one differ in their frames.
    """
    if not sound or set(sound) != set(face):
        raise InputError("views", "sound and face are not of the same clips", "Give both of each")
    for name in sound:
        if len(sound[name]) != len(face[name]):
            raise InputError(
                name, f"{len(sound[name])} frames of sound, {len(face[name])} of the face",
                "Give tracks at the frame rate asked for",
            )  # fmt: skip
    audio = np.concatenate([sound[name] for name in sound])
    clip = np.repeat(list(sound), [len(part) for part in sound.values()])
    return xr.Dataset(
        {
            "audio": (("frame", "coefficient"), audio),
            "face": (("frame", "coordinate"), np.concatenate([face[name] for name in sound])),
        },
        {
            "clip": ("frame", clip),
            "coefficient": [f"c{i}" for i in range(audio.shape[1])],
            "coordinate": list(coordinates),
        },
        {"frame_rate": frame_rate, "n_coefficients": audio.shape[1]},
    )


def read_views(
    paths: Sequence[Path], *, frame_rate: float = FRAME_RATE, coefficients: int = COEFFICIENTS
) -> xr.Dataset:
    """Read recordings: sound files with tracks beside them.

    Of sound and tracks whose lengths differ by no more than two frames, what is longer is cut.

    Raises
    ------
    InputError
        If a file cannot be read, columns differ, or a sound and its tracks differ in length.
    """
    sound, face, names = {}, {}, None
    for path in paths:
        columns, tracks = read_tracks(path.with_suffix(".csv"))
        if names is not None and columns != names:
            raise InputError(path, "its tracks have other columns", "Use one set of columns")
        names, heard = columns, listen(path, frame_rate, coefficients)
        if path.stem in sound:
            raise InputError(path, "the name occurs twice", "Rename a recording")
        common = min(len(heard), len(tracks))
        if max(len(heard), len(tracks)) > common + 2:
            raise InputError(
                path, f"{len(heard)} frames of sound, {len(tracks)} of tracks",
                f"Give tracks at {frame_rate:g} frames a second, or their rate (--rate)",
            )  # fmt: skip
        sound[path.stem], face[path.stem] = heard[:common], tracks[:common]
    return views_of(sound, face, names or [], frame_rate=frame_rate)


def listen(path: Path, frame_rate: float, coefficients: int) -> Float[np.ndarray, "t a"]:
    """Describe the sound of a file by cepstra at the frames of a video."""
    return mfcc(*read_audio(path), frame_rate=frame_rate, n_coefficients=coefficients)


def read_tracks(path: Path) -> tuple[list[str], Float[np.ndarray, "t d"]]:
    """Read the column names and the values of a csv file.

    Raises
    ------
    InputError
        If it is not there, a column has no name of its own, or a line is not as many finite
        numbers as there are names.
    """
    if not path.is_file():
        raise InputError(path, "there is no such file", "Put the tracks beside the sound")
    head, *lines = read_lines(path)
    if not lines:
        raise InputError(path, "it holds no frames", "Write a line of names, then a line a frame")
    names = [name.strip() for name in head.text.split(",")]
    if len(set(names)) < len(names) or "" in names:
        raise head.error("a column has no name, or two have the same", "Name every column")
    rows = []
    for line in lines:
        words = line.text.split(",")
        if len(words) != len(names):
            raise line.error(f"it is not {len(names)} numbers", "Write one a column")
        rows.append([number(line, word) for word in words])
    return names, np.array(rows)
