"""Landmarks of faces: read from files, written, or found by a tracker.

The tracker is dlib's (Kazemi and Sullivan 2014, an ensemble of regression trees after a
detector of frontal faces), which the extra ``face`` installs together with its model of 68
landmarks. That model was learned from 300-W (Sagonas et al. 2016), whose pictures are given
for research only: ask their publishers before using it otherwise.
"""

import importlib.util
import warnings
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float, UInt8

from ...errors import InputError, MotionWarning
from ...files import replacing

HEADER = "frame,landmark,x,y"
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
    try:
        with np.load(path) as stored:
            found = np.asarray(stored["landmarks"], dtype=float) if "landmarks" in stored else None
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise InputError(path, f"it cannot be read ({error})", "Write it with numpy") from error
    if found is None or found.ndim != 3 or found.shape[2] != 2:
        raise InputError(
            path, "it has no array landmarks (frames, landmarks, 2)", "Store them under this name"
        )
    return found


def _csv(path: Path) -> np.ndarray:
    lines = path.read_text(encoding="utf-8").splitlines()
    if not lines or lines[0].replace(" ", "") != HEADER:
        raise InputError(f"{path}:1", f"the columns must be {HEADER}", "Write them in this order")
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        words = line.split(",")
        try:
            frame, landmark = int(words[0]), int(words[1])
            x, y = float(words[2]), float(words[3])
        except (ValueError, IndexError):
            raise InputError(
                f"{path}:{number}", f"{line!r} is no landmark", f"Write {HEADER}"
            ) from None
        if frame < 0 or landmark < 0:
            raise InputError(f"{path}:{number}", "counts are negative", "Count from 0")
        rows.append((frame, landmark, x, y))
    if not rows:
        raise InputError(path, "there are no landmarks in it", "Give a file that is not empty")
    table = np.array(rows)
    index = table[:, :2].astype(int)
    out = np.full((*(index.max(axis=0) + 1), 2), np.nan)
    out[index[:, 0], index[:, 1]] = table[:, 2:]
    return out


def _pts(path: Path) -> np.ndarray:
    text = path.read_text(encoding="utf-8")
    begin, end = text.find("{"), text.find("}")
    try:
        values = np.array([float(word) for word in text[begin + 1 : end].split()])
    except ValueError:
        values = np.empty(0)
    if begin < 0 or end < begin or len(values) == 0 or len(values) % 2:
        raise InputError(path, "there is no list of points in braces", "Give a file of that form")
    return values.reshape(-1, 2) - 1.0


def _warn(what: str) -> None:
    warnings.warn(what, MotionWarning, stacklevel=3)
