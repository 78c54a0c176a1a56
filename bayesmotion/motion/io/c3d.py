"""Reading marker positions from C3D files."""

import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...errors import InputError, MotionWarning
from ..dataset import add_history, make_markers
from .c3d_blocks import Parameters, first_number, read_blocks
from .rates import declared_rate, nominal
from .text import numbered
from .units import metres_of

# Parameters that name the points which are results of a model, and no places in space.
_OUTPUTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")


def read_c3d(
    path: str | Path,
    *,
    frame_rate: float | None = None,
    clip: str | None = None,
    labels: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Read the marker positions of a C3D file.

    What a model worked out (joint angles, forces, moments, powers) is left out, and so are
    analog channels.

    Parameters
    ----------
    path
        The file.
    frame_rate
        Frames a second, where the file does not say or is wrong.
    clip
        Name of the clip, by default the file's stem.
    labels
        What is known of the clip, for example its subject.

    Returns
    -------
    Motion with `position` (frame, joint, space) in the file's unit, NaN where a marker
    was not seen: its residual is negative, or zero with all coordinates zero, or it is not
    finite. Attribute ``metres`` is the metres in that unit, if the file says.

    Warns
    -----
    MotionWarning
        Of markers without a name, or of the same name, which are numbered.

    Raises
    ------
    InputError
        If the file is missing, not C3D, damaged, breaks off, or has no markers.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> motion = bm.read("walk.c3d")  # doctest: +SKIP
    """
    path = Path(path)
    blocks = read_blocks(path)
    names, outputs = _names(blocks.parameters, blocks.values.shape[1])
    kept = [index for index, name in enumerate(names) if name not in outputs]
    if not kept:
        raise InputError(
            path,
            f"there are no markers, but {len(names)} results of a model ({names[0]}, ...)",
            "Export the markers",
        )
    if frame_rate is None:
        told = first_number(blocks.parameters, "POINT", "RATE") or blocks.head.rate
        frame_rate = nominal(declared_rate(path, told, f"POINT:RATE {told:g}"))
    motion = make_markers(
        _unique(path, [names[index] for index in kept]),
        _seen(blocks.values[:, kept]),
        frame_rate=frame_rate,
        clip=path.stem if clip is None else clip,
        metres=_metres(blocks.parameters),
        labels=labels,
        source=path.name,
    )
    if len(kept) == len(names):
        return motion
    return add_history(motion, f"read_c3d: without {len(names) - len(kept)} results of a model")


def _seen(values: Float[np.ndarray, "frame point 4"]) -> Float[np.ndarray, "frame point 3"]:
    """Give the positions, NaN where a marker was not seen."""
    position, residual = values[..., :3].copy(), values[..., 3]
    nowhere = (position == 0.0).all(axis=-1) & (residual == 0.0)
    position[(residual < 0.0) | nowhere | ~np.isfinite(position).all(axis=-1)] = np.nan
    return position


def _texts(parameters: Parameters, name: str) -> list[str]:
    """Give the texts of a parameter of points; long lists go on in NAME2, NAME3, ..."""
    texts: list[str] = []
    for number in range(1, 1000):
        key = ("POINT", name if number == 1 else f"{name}{number}")
        if key not in parameters:
            break
        texts += [text for text in parameters[key] if isinstance(text, str)]
    return texts


def _names(parameters: Parameters, count: int) -> tuple[list[str], set[str]]:
    """Give the names of all points ("" where there is none), and those of a model's results."""
    names = _texts(parameters, "LABELS")[:count]
    outputs = {name for kind in _OUTPUTS for name in _texts(parameters, kind)} - {""}
    return names + [""] * (count - len(names)), outputs


def _unique(path: Path, names: list[str]) -> list[str]:
    """Give every marker a name of its own, and tell which are new."""
    named = [name or f"marker_{index}" for index, name in enumerate(names, start=1)]
    given = numbered(named)
    new = [
        f"{new} ({'twice' if old else 'no name'})"
        for old, new in zip(names, given, strict=True)
        if old != new
    ]
    if new:
        more = f" and {len(new) - 5} more" if len(new) > 5 else ""
        warnings.warn(
            f"{path}: markers got names of their own: {', '.join(new[:5])}{more}",
            MotionWarning,
            stacklevel=3,
        )
    return given


def _metres(parameters: Parameters) -> float | None:
    """Give the metres in the unit of length, where the file says."""
    units = _texts(parameters, "UNITS")
    return metres_of(units[0]) if units else None
