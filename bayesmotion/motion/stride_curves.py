"""Anatomical angles of recordings as curves over the gait cycle, one a stride."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from . import kinematics
from .anatomy import anatomical_angles
from .cycles import find_cycles
from .dataset import label_names, skeleton_of
from .gait_skeleton import upright
from .io.curves import POINTS, STRIDE
from .joining import split


def curves_of(motion: xr.Dataset, points: int = POINTS) -> dict[str, xr.DataArray]:
    """Return the anatomical angles of all strides, as curves over the gait cycle.

    Strides are the straight gait cycles of the recordings, from one left heel strike to the next
    (`cycles_of` finds the same).

    Parameters
    ----------
    motion
        Clips of people walking, of bodies with legs.
    points
        Phases of a curve, from 0 to 100 %.

    Returns
    -------
    By name of the angle (``left knee flexion``; those that all bodies have) degrees (stride, phase)
    with labels: the clip and its labels, the seconds of the stride and its speed (leg lengths a
    second). `bm.contrast` and `bm.norm` compare them.

    Raises
    ------
    InputError
        If no clip has a straight gait cycle, or a body's joints are not known.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> walks = bm.read("walk_01.bvh", "walk_02.bvh", labels="labels.csv")  # doctest: +SKIP
    >>> knee = bm.curves_of(walks)["left knee flexion"]  # doctest: +SKIP
    """
    if points < 2:
        raise InputError("points", f"there are {points}", "Give two or more")
    strides: list[dict[str, np.ndarray]] = []
    labels: dict[str, list[object]] = {}
    names = label_names(motion)
    for clip, part in split(motion).items():
        angles, rate = _angles(part), float(part.attrs["frame_rate"])
        told = {name: str(part[name].values[0]) for name in names}
        for cycle in find_cycles(part):
            at = np.linspace(cycle.start, cycle.end, points)
            strides.append({name: _at(at, angle) for name, angle in angles.items()})
            row = {"clip": clip, **told, "seconds": (cycle.end - cycle.start) / rate,
                   "speed": cycle.speed}  # fmt: skip
            for name, value in row.items():
                labels.setdefault(name, []).append(value)
    if not strides:
        raise InputError(
            "the recordings", "none has a whole straight gait cycle", "Give people walking"
        )
    common = [name for name in strides[0] if all(name in stride for stride in strides)]
    return {name: _curves(name, strides, labels, points) for name in common}


def _curves(
    name: str, strides: Sequence[dict[str, np.ndarray]], labels: dict[str, list[object]],
    points: int,
) -> xr.DataArray:  # fmt: skip
    coords = {label: (STRIDE, np.array(values)) for label, values in labels.items()}
    return xr.DataArray(
        np.stack([stride[name] for stride in strides]), dims=(STRIDE, "phase"),
        coords={"phase": np.linspace(0.0, 100.0, points), **coords}, name=name,
        attrs={"units": "degrees"},
    )  # fmt: skip


def _angles(part: xr.Dataset) -> dict[str, Float[np.ndarray, " n"]]:
    skeleton = skeleton_of(part)
    angle, root = part["angle"].values, part["root_position"].values
    where, _ = kinematics.poses(skeleton, angle, root)
    return anatomical_angles(skeleton, where @ upright(skeleton, where).T)


def _at(frames: Float[np.ndarray, " t"], angle: Float[np.ndarray, " n"]) -> np.ndarray:
    """Return an angle between frames; NaN beside one that is missing."""
    return np.interp(frames, np.arange(len(angle)), angle)
