"""Beats of music: tracked in a recording, read from a file, or from a tempo.

Tracking is librosa's (Ellis 2007): onset strength, then the beat times that dynamic
programming finds at an even tempo. All functions give times in seconds.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...extras import required
from ...motion.io.text import number, read_lines
from .cepstra import read_audio

SAMPLE_RATE = 22050
HOP = 512


def track_beats(
    path: str | Path, *, start_tempo: float = 120.0, tightness: float = 100.0
) -> Float[np.ndarray, " b"]:
    """Track the beats of a sound file.

    Parameters
    ----------
    path
        Any file with sound that `bayesmotion.sensing.audio.cepstra.read_audio` reads.
    start_tempo
        Beats a minute that the search for the tempo favours.
    tightness
        How closely beats keep to the tempo.

    Returns
    -------
    Times of the beats in seconds.

    Raises
    ------
    InputError
        If the file is not there or cannot be read, or no beat is found.
    """
    librosa = required("librosa", "sound")

    sound = _loaded(path)
    _, frames = librosa.beat.beat_track(
        y=sound, sr=SAMPLE_RATE, hop_length=HOP, start_bpm=start_tempo, tightness=tightness
    )
    if len(frames) == 0:
        raise InputError(path, "no beat was found in it", "Give beats by a file or by a tempo")
    return np.asarray(
        librosa.frames_to_time(frames=frames, sr=SAMPLE_RATE, hop_length=HOP), dtype=float
    )


def onset_strength(
    path: str | Path,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Give how strongly something begins at every moment of a sound file.

    Returns
    -------
    Times in seconds, and librosa's onset strength (no unit, at least zero).

    Raises
    ------
    InputError
        As `track_beats`.
    """
    librosa = required("librosa", "sound")

    strength = librosa.onset.onset_strength(y=_loaded(path), sr=SAMPLE_RATE, hop_length=HOP)
    frames = np.arange(len(strength))
    time = librosa.frames_to_time(frames=frames, sr=SAMPLE_RATE, hop_length=HOP)
    return np.asarray(time, dtype=float), np.asarray(strength, dtype=float)


def read_beats(path: str | Path) -> Float[np.ndarray, " b"]:
    """Read beat times in seconds, one a line (further columns are passed over).

    Raises
    ------
    InputError
        If the file is not there, a line does not begin with a finite number, or times do not grow.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path of the beats")
    times = []
    for line in read_lines(path):
        words = line.text.replace(",", " ").split()
        if words and not words[0].startswith("#"):
            times.append(number(line, words[0]))
    beats = np.array(times)
    if len(beats) == 0 or (np.diff(beats) <= 0).any():
        raise InputError(path, "its times do not grow, or there are none", "Sort the beats by time")
    return beats


def even_beats(tempo: float, seconds: float, first: float = 0.0) -> Float[np.ndarray, " b"]:
    """Give the beats of an even tempo.

    Parameters
    ----------
    tempo
        Beats a minute.
    seconds
        Beats before this time are given.
    first
        Time of the first beat in seconds.

    Raises
    ------
    InputError
        If the tempo is not positive or no beat falls before `seconds`.
    """
    if not (np.isfinite(tempo) and tempo > 0) or not first < seconds:
        raise InputError(
            f"a tempo of {tempo} from {first} s to {seconds} s",
            "it has no beats",
            "Give beats a minute above zero and a first beat before the end",
        )
    return np.arange(first, seconds, 60.0 / tempo)


def _loaded(path: str | Path) -> np.ndarray:
    """Read a sound file as one channel at librosa's usual rate."""
    librosa = required("librosa", "sound")

    wave, rate = read_audio(path)
    if len(wave) < rate:
        raise InputError(path, "it is shorter than a second", "Give the whole music")
    # Single precision, as librosa's own reader gives.
    return librosa.resample(y=wave.astype(np.float32), orig_sr=rate, target_sr=SAMPLE_RATE)
