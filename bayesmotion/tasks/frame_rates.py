"""Clips of any frame rate, brought to that of a fit."""

import numpy as np
import xarray as xr

from ..errors import InputError
from ..fit import Fit
from ..motion.dataset import clips
from ..motion.filters import frames_at, nearest
from ..motion.joining import split
from ..motion.resampling import SAME, Filter, keeps_frames, resample
from .cautions import of_training


def at_rate_of(
    fit: Fit, clip: xr.Dataset, *, context: int | None = None, filter: Filter = "lowpass"
) -> tuple[xr.Dataset, tuple[str, ...]]:
    """Return clips at the frame rate of a fit, and in sentences what is to be said of that.

    Parameters
    ----------
    fit
        The fit.
    clip
        One clip or several, NaN where missing.
    context
        So many of the fit's frames are wanted, and what follows them is not looked at; all
        where None.
    filter
        As of `resample`.
    """
    rate, has = float(fit.motion.attrs["frame_rate"]), float(clip.attrs["frame_rate"])
    ratio = has / rate
    if abs(ratio - 1.0) < SAME:
        return clip, ()
    if context is not None:
        # The last place that is wanted may lie between two frames.
        last = int(np.ceil((context - 1) * ratio - 1e-6))
        _require_frames(clip, context, last, rate)
        clip = clip.isel(frame=slice(last + 1))
    made = resample(clip, rate, filter=filter)
    if context is not None:
        made = made.isel(frame=slice(context))
    told = (
        f"clips of {has:g} frames a second were resampled to {rate:g}, the fit's: numbers of "
        "frames are of these"
    )
    # Training clips may have come to the rate in the other way; they are known by their values.
    plain: list[str] = []
    if filter == "lowpass" and keeps_frames(has, rate):
        for part in split(clip).values():
            kept = nearest(part, frames_at(part.sizes["frame"], ratio), rate)
            plain += of_training(fit, kept)
    return made, (told, *plain)


def _require_frames(clip: xr.Dataset, context: int, last: int, rate: float) -> None:
    """Refuse a clip that ends before the last frame that is wanted."""
    if (frames := clip.sizes["frame"]) <= last:
        raise InputError(
            f"clip {clips(clip)[0]!r}",
            f"{context} frames of context at {rate:g} a second, the clip has {frames} at "
            f"{float(clip.attrs['frame_rate']):g}",
            "Give a context that the clip has, in frames of the fit",
        )
