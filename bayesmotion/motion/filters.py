"""One clip at another frame rate: low-pass and interpolation, with rotations and gaps as they are.

Going down, a symmetric FIR filter (a windowed sine cardinal, so that nothing is late) takes out
what is too fast for the new frames; going up, or down by next to nothing, there is nothing to
take out. Frames between those of a clip are on cubic splines. Beyond its ends a clip is
continued by turning it half around its end point, which keeps the end frames in place.

Joints with three channels are filtered as unit quaternions, others as angles without jumps of a
whole turn. What is missing (NaN) stays missing: a new frame is where one of the two frames
about it is, and elsewhere gaps are bridged by straight lines, so that their neighbours are told
all the same.
"""

from itertools import pairwise

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from .dataset import skeletons
from .euler import euler_angles, running_on

# Half the length of the low-pass in new frames, and the Kaiser shape: everything
# above the new Nyquist frequency is down by 50 dB, everything below two thirds of it
# passes within 0.3 %.
_REACH, _SHAPE, _CUTOFF = 10, 5.0, 0.84
# Going down by less there is next to nothing between the old Nyquist frequency and the new one.
_SLIGHT = 1.02
Columns = Float[np.ndarray, "frame column"]


def frames_at(frames: int, ratio: float) -> Float[np.ndarray, " n"]:
    """Return where the frames of a new rate are among so many frames, as far as these go.

    Parameters
    ----------
    frames
        Number of frames.
    ratio
        Old frame rate divided by the new one.
    """
    count = int(np.floor((frames - 1) / ratio + 1e-6)) + 1
    return np.minimum(np.arange(count) * ratio, frames - 1)


def clip_at(part: xr.Dataset, ratio: float) -> xr.Dataset:
    """Return one clip with the frame rate divided by `ratio`, filtered.

    Parameters
    ----------
    part
        Motion of one clip with two frames or more, NaN where missing.
    ratio
        Old frame rate divided by the new one.

    Returns
    -------
    The clip; variables that have one value a frame are those of the nearest frame.
    """
    at = frames_at(part.sizes["frame"], ratio)
    made = nearest(part, at, float(part.attrs["frame_rate"]) / ratio)
    for name, variable in part.data_vars.items():
        if variable.dims[:1] != ("frame",) or variable.ndim < 2:
            continue
        if name == "angle":
            values = _angles(part, at, ratio)
        else:
            flat = variable.values.reshape(variable.shape[0], -1)
            values = _through_gaps(flat, at, ratio)
        made[name] = (variable.dims, values.reshape(len(at), *variable.shape[1:]))
    return made


def nearest(part: xr.Dataset, at: Float[np.ndarray, " n"], rate: float) -> xr.Dataset:
    """Return the frames of a clip that are nearest to these places, as so many a second."""
    rows = np.round(at).astype(int)
    made = part.isel(frame=rows).assign_attrs(frame_rate=rate)
    start = float(part["time"].values[0])
    return made.assign_coords(
        frame=np.arange(len(at)), time=("frame", start + np.arange(len(at)) / rate)
    )


def unwrapped(values: Columns) -> Columns:
    """Return angles without jumps of a whole turn, gaps (NaN) passed over."""
    out = np.array(values, dtype=float)
    for column in out.T:
        there = np.isfinite(column)
        column[there] = np.unwrap(column[there])
    return out


def _angles(part: xr.Dataset, at: Float[np.ndarray, " n"], ratio: float) -> np.ndarray:
    """Return the angles of a clip at places between frames."""
    dofs = part["dof"].values.tolist()
    values = part["angle"].values
    out = _through_gaps(unwrapped(values), at, ratio)
    (skeleton,) = skeletons(part).values()
    for joint in skeleton:
        labels = [f"{joint.name}/{channel}" for channel in joint.channels]
        if len(labels) == 3 and set(labels) <= set(dofs):
            columns = [dofs.index(label) for label in labels]
            order = "".join(channel[1].upper() for channel in joint.channels)
            out[:, columns] = _turned(values[:, columns], order, at, ratio)
    return out


def _turned(
    euler: Float[np.ndarray, "frame 3"], order: str, at: Float[np.ndarray, " n"], ratio: float
) -> Float[np.ndarray, "n 3"]:
    """Return rotations, told by angles, at places between frames."""
    seen = np.isfinite(euler).all(axis=1)
    out = np.full((len(at), 3), np.nan)
    if not seen.any():
        return out
    quaternion = np.full((len(euler), 4), np.nan)
    quaternion[seen] = _same_side(Rotation.from_euler(order, euler[seen]).as_quat())
    made = _through_gaps(quaternion, at, ratio)
    there = np.isfinite(made).all(axis=1)
    if there.any():
        turned = euler_angles(Rotation.from_quat(made[there]), order)
        # They go on from the triple of angles that the clip begins with.
        begun = euler[np.flatnonzero(seen)[0]]
        out[there] = running_on(np.vstack([begun, turned]))[1:]
    return out


def _same_side(quaternion: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Return the same rotations, each quaternion on the side of the one before."""
    with_before = [float(a @ b) for a, b in pairwise(quaternion)]
    return quaternion * np.cumprod([1.0, *np.where(np.array(with_before) < 0, -1.0, 1.0)])[:, None]


def _through_gaps(
    values: Columns, at: Float[np.ndarray, " n"], ratio: float
) -> Float[np.ndarray, "n column"]:
    """Return columns at places between frames, NaN beside frames that are missing."""
    there = np.isfinite(values)
    made = _filtered(_bridged(values, there), at, ratio)
    below, above = np.floor(at).astype(int), np.ceil(at).astype(int)
    return np.where(there[below] & there[above], made, np.nan)


def _bridged(values: Columns, there: Bool[np.ndarray, "frame column"]) -> Columns:
    """Return columns with straight lines over gaps; zero where nothing is seen."""
    out, frames = np.where(there, values, 0.0), np.arange(len(values))
    for column in np.flatnonzero(there.any(axis=0) & ~there.all(axis=0)):
        seen = there[:, column]
        out[:, column] = np.interp(frames, frames[seen], values[seen, column])
    return out


def _filtered(
    values: Columns, at: Float[np.ndarray, " n"], ratio: float
) -> Float[np.ndarray, "n column"]:
    # Half a second of imports, for clips that are resampled alone.
    from scipy.interpolate import CubicSpline

    smooth = values if ratio < _SLIGHT else _lowpass(values, ratio)
    rows = np.round(at).astype(int)
    if np.abs(at - rows).max() < 1e-9:
        return smooth[rows]
    return np.asarray(CubicSpline(np.arange(len(smooth)), smooth)(at))


def _lowpass(values: Columns, ratio: float) -> Columns:
    """Take out of columns what is faster than half the frame rate divided by `ratio`."""
    # Imported here: see `_filtered`.
    from scipy.signal import convolve

    reach = int(np.ceil(_REACH * ratio))
    away = np.arange(-reach, reach + 1)
    taps = np.sinc(_CUTOFF / ratio * away) * np.kaiser(len(away), _SHAPE)
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    return convolve(padded, (taps / taps.sum())[:, None], mode="valid")
