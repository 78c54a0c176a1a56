"""Sound files as a page holds them."""

from base64 import b64encode
from pathlib import Path

import numpy as np

from ..errors import InputError
from .scene import Sound

KINDS = {
    ".mp3": "audio/mpeg", ".wav": "audio/wav", ".ogg": "audio/ogg", ".m4a": "audio/mp4",
    ".flac": "audio/flac", ".mp4": "video/mp4",
}  # fmt: skip


def sound_of(path: str | Path, start: float = 0.0) -> Sound:
    """Return a sound file as it is.

    Parameters
    ----------
    path
        Of the file; browsers play it.
    start
        The second of it at which the motion begins.

    Raises
    ------
    InputError
        If there is no such file, browsers do not play its kind, or the start is no time.
    """
    path = Path(path)
    kind = KINDS.get(path.suffix.lower())
    if kind is None:
        raise InputError(path, "browsers do not play such files", f"Use {', '.join(KINDS)}")
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path")
    if not (np.isfinite(start) and start >= 0.0):
        raise InputError("sound_start", f"it is {start}", "Give a second of the sound")
    return Sound(kind, b64encode(path.read_bytes()).decode("ascii"), float(start))
