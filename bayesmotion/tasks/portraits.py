"""Videos of a person made into tracks of her face, and a portrait to film others with.

The tracks are the parameters of one appearance model, kept beside every video as csv, where
the models of speech look for them; landmarks are read from a file beside the video, or
tracked.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..files import PARAMETERS, replacing
from ..sensing.face.appearance import fit_appearance
from ..sensing.face.files import Portrait
from ..sensing.face.landmarks import read_landmarks, track_landmarks
from ..sensing.face.video import Video, read_video


def make_portrait(
    videos: Sequence[Path],
    *,
    keep: float = 0.95,
    scale: float = 1.0,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[Portrait, dict[str, Float[np.ndarray, "_ k"]]]:
    """Fit one appearance model to videos of a person.

    Parameters
    ----------
    videos
        With landmarks beside them (the same name, ``.landmarks.csv`` or ``.landmarks.npz``),
        or a frontal face for the tracker.
    keep
        Share of the variance that the model keeps.
    scale
        Pixels of the texture for a pixel of the pictures.
    say
        Called with a line after every video.

    Returns
    -------
    The portrait, whose picture is the first video's first, and the parameters (T, k) of
    every video by its name.

    Raises
    ------
    InputError
        If there are no videos, their frame rates differ, names occur twice, or a frame has
        no face.
    """
    if not videos:
        raise InputError("portrait", "there are no videos", "Give one or more")
    if len({path.stem for path in videos}) < len(videos):
        raise InputError("portrait", "a name occurs twice", "Rename a video")
    seen: list[Video] = []
    marked = []
    for path in videos:
        video = read_video(path)
        marked.append(_landmarks_of(path, video))
        seen.append(video)
        say(f"{path.stem}: {len(video.frames)} frames")
        if video.frame_rate != seen[0].frame_rate or marked[-1].shape[1:] != marked[0].shape[1:]:
            raise InputError(
                path, "its frame rate or its landmarks are not the first one's", "Convert it"
            )
    frames = [video.frames for video in seen]
    model = fit_appearance(_joined(videos, frames), np.concatenate(marked), keep=keep, scale=scale)
    pose = model.poses(marked[0][:1])[0]
    portrait = Portrait(model, frames[0][0], pose, seen[0].frame_rate)
    tracks = {
        path.stem: model.encode(pictures, landmarks)
        for path, pictures, landmarks in zip(videos, frames, marked, strict=True)
    }
    return portrait, tracks


def write_parameters(
    path: Path, names: Sequence[str], parameters: Float[np.ndarray, "t k"]
) -> Path:
    """Write tracks as csv: a line of names, then one a frame."""
    PARAMETERS.check(path)
    with replacing(path) as temporary:
        np.savetxt(temporary, parameters, "%.6g", ",", header=",".join(names), comments="")
    return path


def _landmarks_of(path: Path, video: Video) -> np.ndarray:
    """Read the landmarks beside a video, or track them; every frame must have them."""
    beside = [path.with_name(f"{path.stem}.landmarks{suffix}") for suffix in (".csv", ".npz")]
    found = next((file for file in beside if file.is_file()), None)
    landmarks = track_landmarks(video.frames) if found is None else read_landmarks(found)
    if len(landmarks) != len(video.frames):
        raise InputError(
            found or path,
            f"landmarks of {len(landmarks)} frames, the video has {len(video.frames)}",
            "Give landmarks for every frame",
        )
    missing = np.flatnonzero(~np.isfinite(landmarks).all(axis=(1, 2)))
    if len(missing):
        raise InputError(
            found or path,
            f"frame {missing[0]} and {len(missing) - 1} others have no landmarks",
            "Cut these frames out, or mark them by hand",
        )
    return landmarks


def _joined(videos: Sequence[Path], frames: Sequence[np.ndarray]) -> np.ndarray:
    """Put the pictures of videos one after another."""
    for path, pictures in zip(videos, frames, strict=True):
        if pictures.shape[1:] != frames[0].shape[1:]:
            raise InputError(path, "its pictures have another size", "Scale it to the first's")
    return np.concatenate(frames)
