"""Faces of sound files, as tables."""

from pathlib import Path

import numpy as np
import xarray as xr

from ..errors import InputError
from ..files import TRACKS, replacing
from ..fit import Fit
from ..sensing.face.views import listen
from .outcome import table_of
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
    The table of the face's tracks (`tasks.outcome.table_of`), in the units of the training
    tracks, with the attribute ``frame_rate``.

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
    shown = fit.motion["face"]
    names = [str(name) for name in shown[shown.dims[1]].values]
    times = np.arange(len(face.means())) / rate
    return table_of(
        face, names, [""] * len(names), clip=path.stem, times=times, attrs={"frame_rate": rate}
    )


def write_tracks(made: xr.Dataset, path: str | Path) -> None:
    """Write the face of `speak_file` as training tracks are: csv, a line a frame, with their sd."""
    TRACKS.check(path)
    names = [str(name) for name in made["channel"].values]
    head = ",".join(["time", *names, *(f"{name} sd" for name in names)])
    values = [made["time"].values[:, None], made["mean"].values, made["sd"].values]
    with replacing(path) as temporary:
        np.savetxt(temporary, np.concatenate(values, axis=1), "%.6g", ",", header=head, comments="")
