"""Fewer frames a second, with a word on what that folds over.

What a signal does faster than half the new frame rate (the new Nyquist frequency)
does not vanish when frames are left out: it comes back at a lower frequency.
"""

import warnings
from typing import Literal

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.signal import detrend, windows

from ..errors import InputError, MotionWarning
from .dataset import add_history, clips
from .joining import concat, split

# Share of the power above the new Nyquist frequency beyond which leaving frames out
# is warned of. One per cent of the power is a tenth of the amplitude.
ALIAS_LIMIT = 0.01
# Half the length of the low-pass in new frames, and the Kaiser shape: everything
# above the new Nyquist frequency is down by 50 dB, everything below two thirds of it
# passes within 0.3 %.
_REACH, _SHAPE, _CUTOFF = 10, 5.0, 0.84


def downsample(
    motion: xr.Dataset, factor: int, *, filter: Literal["none", "lowpass"] = "lowpass"
) -> xr.Dataset:
    """Keep every `factor`-th frame of every clip.

    Parameters
    ----------
    motion
        Any Motion. The first frame of each clip stays the first.
    factor
        At least 1; the frame rate becomes the old one divided by it.
    filter
        ``"none"`` keeps frames as they are. ``"lowpass"`` first removes what is faster
        than half the new frame rate, without delay (a symmetric FIR filter on the
        unwrapped angles and the root path; beyond its ends a clip is continued by
        turning it half around its end point, which keeps the end frames in place).

    Returns
    -------
    Motion whose `history` has a line more, with the share of the power of the movement
    that lay above half the new frame rate.

    Warns
    -----
    MotionWarning
        If that share exceeds 1 % in some clip and nothing is done about it.

    Raises
    ------
    InputError
        If the factor or filter is not usable, a clip gets shorter than two frames, or
        the filter meets missing values.
    """
    if factor < 1 or filter not in ("none", "lowpass"):
        raise InputError(
            "downsample", f"factor {factor}, filter {filter!r}", "Use 1, 2, ...; none or lowpass"
        )
    if factor == 1:
        return motion
    parts = split(motion)
    shares = {clip: _share(part, factor) for clip, part in parts.items()}
    worst = max(shares, key=lambda clip: shares[clip])
    rate = motion.attrs["frame_rate"]
    line = (
        f"downsample: factor {factor}, filter {filter}, {rate:g} to {rate / factor:g} Hz; share of "
        f"power above {rate / factor / 2:g} Hz: {shares[worst]:.3%} in clip {worst} (the largest)"
    )
    if filter == "none" and shares[worst] > ALIAS_LIMIT:
        warnings.warn(
            f"{line}. It now shows as slower movement; use filter='lowpass'.",
            MotionWarning,
            stacklevel=2,
        )
    result = concat([_fewer(part, factor, filter) for part in parts.values()])
    return add_history(result, line)


def _fewer(part: xr.Dataset, factor: int, filter: str) -> xr.Dataset:
    """Do the work for one clip."""
    clip = clips(part)[0]
    if part.sizes["frame"] <= factor:
        raise InputError(
            f"clip {clip!r}",
            f"of its {part.sizes['frame']} frames only one would be left",
            "Leave the clip out or use a smaller factor",
        )
    if filter == "lowpass":
        part = part.assign({name: _smooth(part, name, factor) for name in part.data_vars})
    part = part.isel(frame=slice(None, None, factor))
    return part.assign_coords(frame=np.arange(part.sizes["frame"])).assign_attrs(
        frame_rate=part.attrs["frame_rate"] / factor
    )


def _smooth(part: xr.Dataset, name: object, factor: int) -> tuple:
    """Give one variable of a clip without what is faster than the new Nyquist frequency."""
    variable = part[name]
    values = variable.values.reshape(part.sizes["frame"], -1)
    if not np.isfinite(values).all():
        raise InputError(
            f"clip {clips(part)[0]!r}",
            f"missing values in {name}, over which the low-pass cannot go",
            "Fill them in, or use filter='none'",
        )
    if name == "angle":
        values = np.unwrap(values, axis=0)
    return variable.dims, _lowpass(values, factor).reshape(variable.shape)


def _lowpass(values: Float[np.ndarray, "frame column"], factor: int) -> np.ndarray:
    """Filter along the frames with a symmetric FIR filter."""
    reach = _REACH * factor
    taps = np.sinc(_CUTOFF / factor * np.arange(-reach, reach + 1))
    taps *= np.kaiser(len(taps), _SHAPE)
    taps /= taps.sum()
    longer = np.pad(values, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    return np.stack([np.convolve(column, taps, mode="valid") for column in longer.T], axis=1)


def _share(part: xr.Dataset, factor: int) -> float:
    """Give the share of power above the new Nyquist frequency, the larger of angles and path."""
    shares = [0.0]
    for name, variable in part.data_vars.items():
        values = variable.values.reshape(part.sizes["frame"], -1)
        values = values[:, np.isfinite(values).all(axis=0)]
        if name == "angle":
            values = np.unwrap(values, axis=0)
        if values.size:
            shares.append(_share_above(values, 1.0 / factor))
    return max(shares)


def _share_above(values: Float[np.ndarray, "frame column"], cut: float) -> float:
    """Give the share of the summed power above `cut` (in units of the old Nyquist frequency)."""
    # Without trend and with a window, a path that does not end where it began is not
    # mistaken for fast movement.
    windowed = detrend(values, axis=0) * windows.hann(len(values), sym=False)[:, None]
    # What rounding leaves of a body that turns evenly is no movement at all.
    if np.abs(windowed).max() <= 1e-9 * np.abs(values).max():
        return 0.0
    power = (np.abs(np.fft.rfft(windowed, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(len(values), d=0.5)
    return float(power[frequency > cut].sum() / power.sum())
