"""Talking faces in the speech study: made from sound alone, and measured against the truth.

Models are given as functions, so that whatever makes one track of another can take part:
``train(sounds, faces)`` learns from clips and gives ``speak(sound)``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from ...sensing.face.appearance import AppearanceModel
from ...sensing.face.procrustes import moved, pose_to
from ..stages import Say, kept_arrays
from .models import Train


@dataclass(frozen=True)
class Talk:
    """A clip of someone who talks.

    sound
        (T, A) what is heard at every frame.
    frames
        (T, height, width, 3) pictures.
    landmarks
        (T, L, 2) x, y in pixels.
    """

    name: str
    person: str
    sound: Float[np.ndarray, "t a"]
    frames: UInt8[np.ndarray, "t h w 3"]
    landmarks: Float[np.ndarray, "t l 2"]


@dataclass(frozen=True)
class Lips:
    """Which landmarks are the lips', and two of them between which the mouth opens."""

    all: slice
    upper: int
    lower: int


def spoken(
    training: Sequence[Talk],
    tests: Sequence[Talk],
    face: Mapping[str, AppearanceModel],
    models: Mapping[str, Train],
    kept: Path,
    say: Say,
) -> dict[str, list[Float[np.ndarray, "t k"]]]:
    """Make the appearance parameters of test clips from their sound, by every model.

    Parameters
    ----------
    training, tests
        Clips.
    face
        Every person's appearance model.
    models
        How they are trained.
    kept
        Folder where what a model made is kept; what is there is not made again.
    say
        Called with a line after every model.
    """
    sounds = [talk.sound for talk in training]
    faces = [face[talk.person].encode(talk.frames, talk.landmarks) for talk in training]
    made: dict[str, list[np.ndarray]] = {}
    for name, train in models.items():

        def tracks(name: str = name, train: Train = train) -> dict[str, np.ndarray]:
            speak = train(sounds, faces)
            found = {talk.name: speak(talk.sound) for talk in tests}
            say(f"{name} has spoken {len(tests)} clips")
            return found

        stored = kept_arrays(kept / f"{name}.npz", tracks)
        made[name] = [stored[talk.name] for talk in tests]
    return made


def measured(
    tests: Sequence[Talk],
    tracks: Sequence[Float[np.ndarray, "t k"]],
    face: Mapping[str, AppearanceModel],
    lips: Lips,
) -> dict[str, float]:
    """Compare made faces with the true ones, where and how the head is held left aside.

    Returns
    -------
    ``landmarks_px`` and ``lips_px``, root mean square distances in pixels; ``opening_correlation``
    and ``opening_peak_to_peak`` (a share of the truth's) of the mouth's opening, means over
    clips; ``grey_levels``, the root mean square error of the texture.
    """
    distances, greys, correlations, ranges = [], [], [], []
    for talk, track in zip(tests, tracks, strict=True):
        model = face[talk.person]
        shapes, textures = model.decode(track)
        true = moved(talk.landmarks, pose_to(talk.landmarks, model.mean_shape))
        # In the units of the pictures, and with the made shape's own place taken off as well.
        scale = np.linalg.norm(model.poses(talk.landmarks)[:, :2], axis=1)
        made = moved(shapes, pose_to(shapes, true))
        distances.append(((made - true) ** 2).sum(axis=-1) * scale[:, None] ** 2)
        greys.append((textures - model.textures(talk.frames, talk.landmarks)) ** 2)
        opened = [shape[:, lips.lower, 1] - shape[:, lips.upper, 1] for shape in (shapes, true)]
        ranges.append(np.ptp(opened[0]) / np.ptp(opened[1]))
        if np.ptp(opened[0]) > 0:
            correlations.append(np.corrcoef(opened[0], opened[1])[0, 1])
    squared = np.concatenate(distances)
    found = {
        "landmarks_px": float(np.sqrt(squared.mean())),
        "lips_px": float(np.sqrt(squared[:, lips.all].mean())),
        "opening_peak_to_peak": float(np.mean(ranges)),
        "grey_levels": float(np.sqrt(np.concatenate(greys).mean())),
    }
    if correlations:
        found["opening_correlation"] = float(np.mean(correlations))
    return found


def compared(
    tests: Sequence[Talk],
    made: Mapping[str, Sequence[np.ndarray]],
    face: Mapping[str, AppearanceModel],
    lips: Lips,
) -> dict[str, dict[str, float]]:
    """Measure every model's faces, the encoder's own, and a face that does not move."""
    encoded = [face[talk.person].encode(talk.frames, talk.landmarks) for talk in tests]
    still = [np.zeros_like(one) for one in encoded]
    rows = {"encoder": encoded, "still_face": still, **made}
    return {name: measured(tests, tracks, face, lips) for name, tracks in rows.items()}
