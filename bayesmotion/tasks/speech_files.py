"""Faces of sound files, as tables."""

from pathlib import Path

import numpy as np
import xarray as xr

from ..errors import InputError
from ..files import TRACKS, replacing
from ..fit import Fit
from ..sensing.face.views import listen
from .speech import DRAWS, Start, audio_to_face, sound_clip


def speak_file(
    fit: Fit, path: Path, *, draws: int = DRAWS, start: Start | None = None, seed: int = 0
) -> xr.Dataset:
    """Return the face of a sound file.

    Parameters
    ----------
    fit
        Of a model of the views ``audio`` and ``face``.
    path
        Of the sound, or of a video.
    draws, start, seed
        As of `tasks.speech.audio_to_face`.

    Returns
    -------
    ``face`` and ``sd``, its standard deviation, (frame, coordinate), in the units of the
    training tracks, with ``time`` in seconds and the attribute ``frame_rate``.

    Raises
    ------
    InputError
        If the file cannot be read or the fit is of no such model.
    """
    attrs = fit.motion.attrs
    if "frame_rate" not in attrs or "n_coefficients" not in attrs:
        raise InputError(
            "fit", "it does not say how sound was described", "Fit data made by `views_of`"
        )
    rate = float(attrs["frame_rate"])
    sound = listen(path, rate, int(attrs["n_coefficients"]))
    face = audio_to_face(fit, sound_clip(fit, sound), draws=draws, start=start, seed=seed)
    dims = ("frame", "coordinate")
    mean, shown = face.means(), fit.motion["face"]
    return xr.Dataset(
        {"face": (dims, mean), "sd": (dims, face.sds())},
        {
            "time": ("frame", np.arange(len(mean)) / rate),
            "coordinate": list(shown[shown.dims[1]].values),
        },
        {"frame_rate": rate},
    )


def write_tracks(made: xr.Dataset, path: str | Path) -> None:
    """Write the face of `speak_file` as csv: time, every coordinate, and their sd."""
    TRACKS.check(path)
    names = [str(name) for name in made["coordinate"].values]
    head = ",".join(["time", *names, *(f"{name} sd" for name in names)])
    values = [made["time"].values[:, None], made["face"].values, made["sd"].values]
    with replacing(path) as temporary:
        np.savetxt(temporary, np.concatenate(values, axis=1), "%.6g", ",", header=head, comments="")
