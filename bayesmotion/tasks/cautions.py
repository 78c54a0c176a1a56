"""What is to be said of a task's result because of the fit, or of the clip it was given.

Draws that are not to be trusted give results that are not; and of a clip that trained the fit
a model says what it has seen, not what it would say of a new one. Such a clip is known by its
values, whatever it is called.
"""

import warnings
from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import MotionWarning
from ..fit import Fit
from ..motion.dataset import clips

# How far values may be apart that are the same: digits of files, and the ends of filters.
SAME = 1e-4
# Share of a clip's frames that must be among those of training.
MOST = 0.8


def cautions(fit: Fit, clip: xr.Dataset | None = None) -> tuple[str, ...]:
    """Return, in a sentence each, what to know before believing what a task says.

    Parameters
    ----------
    fit
        The fit.
    clip
        What the task is given of a clip, where it is given one; NaN where missing.
    """
    return (*_of_training(fit, clip), *_of_draws(fit))


def warn(task: str, sentences: Sequence[str], *, stacklevel: int = 3) -> None:
    """Warn of what is to be said of a task's result.

    Warns
    -----
    MotionWarning
        A sentence each.
    """
    for sentence in sentences:
        warnings.warn(f"{task}: {sentence}", MotionWarning, stacklevel=stacklevel)


def training_clip(motion: xr.Dataset, clip: xr.Dataset) -> str | None:
    """Return the training clip that has the values of a clip, or of most of its frames.

    Parameters
    ----------
    motion
        The training clips.
    clip
        Frames of one clip; NaN where missing.
    """
    name = next((n for n in ("angle", "position") if n in clip and n in motion), None)
    if name is None:
        name = next((str(n) for n in clip.data_vars if n in motion), None)
    if name is None:
        return None
    here, there = clip[name], motion[name]
    if "dof" in here.dims:
        shared = [dof for dof in here["dof"].values.tolist() if dof in set(there["dof"].values)]
        here, there = here.sel(dof=shared), there.sel(dof=shared)
    if here.dims != there.dims or here.shape[1:] != there.shape[1:] or here.ndim < 2:
        return None
    rows, known = _rows(here), _rows(there)
    start = _start(rows, known)
    return None if start is None else str(motion["clip"].values[start])


def _rows(values: xr.DataArray) -> Float[np.ndarray, "n d"]:
    return np.asarray(values.values, float).reshape(values.shape[0], -1)


def _start(rows: Float[np.ndarray, "n d"], known: Float[np.ndarray, "m d"]) -> int | None:
    """Return where in known rows these rows stand one after the other, None if nowhere."""
    seen = np.isfinite(rows).any(axis=0)
    rows, known = rows[:, seen], known[:, seen]
    if not seen.any() or len(known) < len(rows):
        return None
    # One row in the middle finds the places; all rows decide.
    middle = int(np.argmax(np.isfinite(rows[len(rows) // 2 :]).all(axis=1))) + len(rows) // 2
    places = np.flatnonzero(_alike(known, rows[middle])) - middle
    for place in places[(places >= 0) & (places + len(rows) <= len(known))]:
        if _alike(known[place : place + len(rows)], rows).mean() >= MOST:
            return int(place + middle)
    return None


def _alike(known: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return which rows are the same, but for what is missing."""
    apart = np.abs(known - rows)
    return (np.where(np.isfinite(apart), apart, 0.0).max(axis=1) <= SAME) & np.isfinite(apart).any(
        axis=1
    )


def _of_training(fit: Fit, clip: xr.Dataset | None) -> Iterator[str]:
    """Tell of a clip that trained the fit; arguments as of `cautions`."""
    if clip is not None and (trained := training_clip(fit.motion, clip)) is not None:
        name = clips(clip)[0] if "clip" in clip.coords else "the clip"
        called = "" if name == trained else f" as {trained!r}"
        yield f"this clip trained the fit: {name!r} is in it{called}, and is no test of it"


def _of_draws(fit: Fit) -> Iterator[str]:
    for text in fit.warnings:
        if "not converged" in text and fit.point_estimate:
            yield "the fit has not converged: go on with it, or give it more steps"
        else:
            yield f"the fit's draws: {text}"
