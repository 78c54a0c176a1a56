"""Landmarks of faces: read from files, written, or found by a tracker.

The tracker is dlib's (Kazemi and Sullivan 2014, an ensemble of regression trees after a
detector of frontal faces), which the extra ``face`` installs together with its model of 68
landmarks. That model was learned from 300-W (Sagonas et al. 2016), whose pictures are given
for research only: ask their publishers before using it otherwise.
"""

import importlib.util
import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from ...errors import InputError, MotionWarning
from ...files import replacing
from ...motion.io.text import number, numbers, read_lines
from ...npz import read_arrays

HEADER = "frame,landmark,x,y"
EMPTY = 10_000  # so many places for every landmark of a csv, at most
MODEL = "shape_predictor_68_face_landmarks.dat"
# The tracker's points are whole pixels; their mean over boxes shifted by these shares of
# the box's width is finer, and does not jump when the box does.
SHIFTS = (-0.02, 0.0, 0.02)


def read_landmarks(path: str | Path) -> Float[np.ndarray, "t l 2"]:
    """Read landmarks x, y in pixels (the first pixel's centre is 0, 0) of a video's frames.

    Parameters
    ----------
    path
        A table ``.csv`` with the columns frame, landmark, x, y, both counted from 0 (what is
        not there is NaN); an ``.npz`` with an array ``landmarks``; a ``.pts`` of one picture
        (the form of 300-W, which counts pixels from 1); or a folder with a ``.pts`` for
        every frame, in the order of their names.

    Raises
    ------
    InputError
        If it is not there or not of these forms, or pictures differ in their landmarks.
    """
    path = Path(path)
    if path.is_dir():
        files = sorted(path.glob("*.pts"))
        if not files:
            raise InputError(path, "there are no .pts files in it", "Give a folder with some")
        shapes = [_pts(file) for file in files]
        for file, shape in zip(files, shapes, strict=True):
            if shape.shape != shapes[0].shape:
                raise InputError(
                    file,
                    f"it has {len(shape)} landmarks and the first file {len(shapes[0])}",
                    "Mark all pictures alike",
                )
        return np.stack(shapes)
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path of the landmarks")
    readers = {".csv": _csv, ".npz": _npz, ".pts": lambda file: _pts(file)[None]}
    if path.suffix.lower() not in readers:
        raise InputError(path, "landmarks are read from csv, npz and pts", "Convert the file")
    return readers[path.suffix.lower()](path)


def write_landmarks(path: str | Path, landmarks: Float[np.ndarray, "t l 2"]) -> Path:
    """Write landmarks as csv or npz, by the name's suffix; missing ones are left out of a csv.

    Raises
    ------
    InputError
        If the name has another suffix.
    """
    path = Path(path)
    if path.suffix.lower() not in (".csv", ".npz"):
        raise InputError(path, "landmarks are written as csv or npz", "Choose one by the name")
    with replacing(path) as temporary:
        if path.suffix.lower() == ".npz":
            np.savez_compressed(temporary, landmarks=landmarks)
        else:
            lines = [HEADER]
            for (frame, number), point in _points(landmarks):
                lines.append(f"{frame},{number},{point[0]:.4f},{point[1]:.4f}")
            temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def track_landmarks(
    frames: UInt8[np.ndarray, "t h w 3"], *, model: str | Path | None = None
) -> Float[np.ndarray, "t l 2"]:
    """Find the landmarks of the face in every picture with dlib's tracker.

    Parameters
    ----------
    frames
        Red, green and blue.
    model
        File of a dlib shape predictor; by default the one of 68 landmarks that the extra
        ``face`` installs.

    Returns
    -------
    x, y in pixels; NaN where no face was found.

    Raises
    ------
    InputError
        If dlib or its model is not installed, the model cannot be read, or no picture has a
        face.

    Warns
    -----
    MotionWarning
        If some pictures have no face, or several of which the largest is taken.
    """
    detector, predictor = _tracker(model)
    rows, crowded = [], 0
    for frame in frames:
        picture = np.ascontiguousarray(frame)
        # Faces of 80 pixels are found as they are; smaller ones in the picture made larger.
        boxes = list(detector(picture, 0)) or list(detector(picture, 1))
        crowded += len(boxes) > 1
        rows.append(_marked(picture, max(boxes, key=_area), predictor) if boxes else None)
    known = [row for row in rows if row is not None]
    if not known:
        raise InputError("pictures", "no face was found in any", "Give frontal faces, upright")
    if len(known) < len(rows):
        _warn(f"no face was found in {len(rows) - len(known)} of {len(rows)} pictures")
    if crowded:
        _warn(f"{crowded} pictures show several faces; the largest is taken")
    missing = np.full_like(known[0], np.nan)
    return np.stack([missing if row is None else row for row in rows])


def _tracker(model: str | Path | None):
    """Load dlib's detector and a shape predictor."""
    if importlib.util.find_spec("dlib") is None:
        raise _not_installed("dlib")
    import dlib

    path = _model_path() if model is None else Path(model)
    if not path.is_file():
        raise InputError(path, "there is no such model", "Give a dlib shape predictor")
    try:
        predictor = dlib.shape_predictor(str(path))  # pyright: ignore[reportAttributeAccessIssue]
    except RuntimeError as error:
        raise InputError(
            path, f"it is no shape predictor ({error})", "Give a dlib shape predictor"
        ) from error
    return dlib.get_frontal_face_detector(), predictor  # pyright: ignore[reportAttributeAccessIssue]


def _model_path() -> Path:
    """Find the installed model without importing its package, which needs setuptools."""
    found = importlib.util.find_spec("face_recognition_models")
    if found is None or not found.submodule_search_locations:
        raise _not_installed("its model of 68 landmarks")
    return Path(found.submodule_search_locations[0]) / "models" / MODEL


def _not_installed(what: str) -> InputError:
    return InputError(
        "tracker",
        f"{what} is not installed",
        "Install bayesmotion[face], or give landmarks in a file",
    )


def _marked(picture: np.ndarray, box, predictor) -> np.ndarray:
    """Give the mean of the landmarks over shifts of the box."""
    import dlib

    found = []
    for right in SHIFTS:
        for down in SHIFTS:
            shift = dlib.point(round(right * box.width()), round(down * box.height()))  # pyright: ignore[reportAttributeAccessIssue]
            moved = dlib.translate_rect(box, shift)  # pyright: ignore[reportAttributeAccessIssue]
            found.append([(part.x, part.y) for part in predictor(picture, moved).parts()])
    return np.mean(found, axis=0)


def _area(box) -> int:
    return box.area()


def _points(landmarks: np.ndarray):
    """Give the landmarks that are known, with their frame and number."""
    for index in np.ndindex(*landmarks.shape[:2]):
        if np.isfinite(landmarks[index]).all():
            yield index, landmarks[index]


def _npz(path: Path) -> np.ndarray:
    arrays = read_arrays(path, "landmarks", "Write it with numpy", names=("landmarks",))
    found = arrays.get("landmarks", np.zeros(0))
    if found.ndim != 3 or found.shape[2] != 2 or not len(found) or found.dtype.kind not in "iuf":
        raise InputError(
            path, "it has no array landmarks (frames, landmarks, 2)", "Store them under this name"
        )
    if np.isinf(found).any():
        raise InputError(path, "a landmark is infinitely far away", "What is missing is NaN")
    return found.astype(float)


def _csv(path: Path) -> np.ndarray:
    head, *lines = read_lines(path)
    if head.text.replace(" ", "") != HEADER:
        raise head.error(f"the columns must be {HEADER}", "Write them in this order")
    rows = []
    for line in lines:
        words = line.text.split(",")
        if len(words) != 4 or not (words[0].strip().isdecimal() and words[1].strip().isdecimal()):
            raise line.error(
                f"{line.text!r} is no landmark", f"Write {HEADER}, both counted from 0"
            )
        rows.append((int(words[0]), int(words[1]), number(line, words[2]), number(line, words[3])))
    if not rows:
        raise InputError(path, "there are no landmarks in it", "Give a file that is not empty")
    frames, count = max(row[0] for row in rows) + 1, max(row[1] for row in rows) + 1
    if frames * count > EMPTY * len(rows):
        raise InputError(
            path, f"of {frames} frames with {count} landmarks {len(rows)} landmarks are there",
            "Count frames and landmarks from 0, one after the other",
        )  # fmt: skip
    out = np.full((frames, count, 2), np.nan)
    for frame, landmark, x, y in rows:
        out[frame, landmark] = x, y
    return out


def _pts(path: Path) -> np.ndarray:
    lines = read_lines(path)
    begin = next((i for i, line in enumerate(lines) if line.text.endswith("{")), len(lines))
    inside = []
    for line in lines[begin + 1 :]:
        if line.text.startswith("}"):
            break
        inside.append(line)
    else:
        raise InputError(path, "there is no list of points in braces", "Give a file of that form")
    points = [numbers(line, line.words, 2) for line in inside if line.text]
    if not points:
        raise InputError(path, "its list of points is empty", "Mark the picture")
    return np.array(points) - 1.0


def _warn(what: str) -> None:
    warnings.warn(what, MotionWarning, stacklevel=3)
