"""More or fewer frames a second, with a word on what fewer fold over.

What a signal does faster than half the new frame rate (the new Nyquist frequency)
does not vanish when frames are left out: it comes back at a lower frequency.
"""

import warnings
from typing import Literal

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError, MotionWarning
from .dataset import add_history, clips
from .filters import clip_at, frames_at, nearest, unwrapped
from .joining import concat, split

Filter = Literal["none", "lowpass"]
# Share of the power above the new Nyquist frequency beyond which leaving frames out
# is warned of. One per cent of the power is a tenth of the amplitude.
ALIAS_LIMIT = 0.01
# Rates that differ by less are one.
SAME = 1e-9


def resample(motion: xr.Dataset, rate: float, *, filter: Filter = "lowpass") -> xr.Dataset:
    """Bring every clip to a frame rate, from any to any.

    Parameters
    ----------
    motion
        Any Motion, NaN where missing; gaps stay gaps. The first frame of each clip stays the
        first.
    rate
        Frames a second.
    filter
        ``"lowpass"`` first removes what is faster than half the new frame rate, without delay,
        and goes through frames by cubic splines where there are to be more of them
        (`motion.filters`). ``"none"`` keeps frames as they are, where every n-th frame makes
        the rate; where it does not, frames are made as by ``"lowpass"``.

    Returns
    -------
    Motion whose `history` has a line more, where frames were to become fewer with the share of
    the power of the movement that lay above half the new frame rate.

    Warns
    -----
    MotionWarning
        If that share exceeds 1 % in some clip and nothing is done about it.

    Raises
    ------
    InputError
        If the rate or filter is not usable, or a clip gets shorter than two frames.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> _, walks = bm.example("multifactor")
    >>> bm.resample(walks, 24.0).attrs["frame_rate"]
    24.0
    """
    if not (np.isfinite(rate) and rate > 0) or filter not in ("none", "lowpass"):
        raise InputError(
            "resample", f"{rate:g} frames a second, filter {filter!r}",
            "Give the frames a second; filter none or lowpass",
        )  # fmt: skip
    has = float(motion.attrs["frame_rate"])
    ratio = has / rate
    if abs(ratio - 1.0) < SAME:
        return motion
    parts = split(motion)
    for clip, part in parts.items():
        _require_two(clip, part.sizes["frame"], ratio)
    keeping = filter == "none" and keeps_frames(has, rate)
    line = f"resample: {has:g} to {rate:g} Hz, filter {'none' if keeping else 'lowpass'}"
    if ratio > 1.0:
        shares = {clip: _share(part, ratio) for clip, part in parts.items()}
        worst = max(shares, key=lambda clip: shares[clip])
        line += (
            f"; share of power above {rate / 2:g} Hz: {shares[worst]:.3%} in clip {worst} "
            "(the largest)"
        )
        if keeping and shares[worst] > ALIAS_LIMIT:
            warnings.warn(
                f"{line}. It now shows as slower movement; use filter='lowpass'.",
                MotionWarning,
                stacklevel=2,
            )
    made = [
        nearest(part, frames_at(part.sizes["frame"], ratio), rate)
        if keeping
        else clip_at(part, ratio)
        for part in parts.values()
    ]
    return add_history(concat(made), line).assign_attrs(frame_rate=float(rate))


def downsample(motion: xr.Dataset, factor: int, *, filter: Filter = "lowpass") -> xr.Dataset:
    """Keep every `factor`-th frame of every clip: `resample` to a whole part of the frame rate.

    Parameters
    ----------
    motion, filter
        As of `resample`.
    factor
        At least 1; the frame rate becomes the old one divided by it.

    Raises
    ------
    InputError
        As `resample`.
    """
    if factor < 1:
        raise InputError("downsample", f"factor {factor}", "Use 1, 2, ...")
    return resample(motion, float(motion.attrs["frame_rate"]) / factor, filter=filter)


def at_rate(
    clip: xr.Dataset, rate: float, *, context: int | None = None, filter: Filter = "lowpass"
) -> tuple[xr.Dataset, tuple[str, ...]]:
    """Return clips at a frame rate for a task, and in sentences what is to be said of that.

    Parameters
    ----------
    clip, rate, filter
        As of `resample`.
    context
        So many frames of the new rate are wanted, and what follows them is not looked at; all
        where None.

    Raises
    ------
    InputError
        If a clip has no room for the context, or as `resample`.
    """
    has = float(clip.attrs["frame_rate"])
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
    return made, (told,)


def _require_frames(clip: xr.Dataset, context: int, last: int, rate: float) -> None:
    """Refuse a clip that ends before the last frame that is wanted."""
    if (frames := clip.sizes["frame"]) <= last:
        raise InputError(
            f"clip {clips(clip)[0]!r}",
            f"{context} frames of context at {rate:g} a second, the clip has {frames} at "
            f"{float(clip.attrs['frame_rate']):g}",
            "Give a context that the clip has, in frames of the fit",
        )


def keeps_frames(has: float, rate: float) -> bool:
    """Whether every n-th frame of a rate makes another one."""
    factor = round(has / rate)
    return factor >= 1 and abs(has / factor - rate) <= SAME * rate


def _require_two(clip: str, frames: int, ratio: float) -> None:
    """Refuse a clip of which only one frame would be left."""
    if len(frames_at(frames, ratio)) < 2:
        raise InputError(
            f"clip {clip!r}",
            f"of its {frames} frames only one would be left",
            "Leave the clip out or use a higher rate",
        )


def _share(part: xr.Dataset, ratio: float) -> float:
    """Give the share of power above the new Nyquist frequency, the larger of angles and path."""
    shares = [0.0]
    for name, variable in part.data_vars.items():
        values = variable.values.reshape(part.sizes["frame"], -1)
        values = values[:, np.isfinite(values).all(axis=0)]
        if name == "angle":
            values = unwrapped(values)
        if values.size:
            shares.append(_share_above(values, 1.0 / ratio))
    return max(shares)


def _share_above(values: Float[np.ndarray, "frame column"], cut: float) -> float:
    """Give the share of the summed power above `cut` (in units of the old Nyquist frequency)."""
    # Half a second of imports, for clips that are resampled alone.
    from scipy.signal import detrend, windows

    # Without trend and with a window, a path that does not end where it began is not
    # mistaken for fast movement.
    windowed = detrend(values, axis=0) * windows.hann(len(values), sym=False)[:, None]
    # What rounding leaves of a body that turns evenly is no movement at all.
    if np.abs(windowed).max() <= 1e-9 * np.abs(values).max():
        return 0.0
    power = (np.abs(np.fft.rfft(windowed, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(len(values), d=0.5)
    return float(power[frequency > cut].sum() / power.sum())
