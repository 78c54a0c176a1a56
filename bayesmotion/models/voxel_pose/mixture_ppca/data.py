"""Points as the mixture sees them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from ....errors import InputError
from ....gp.linalg import AnyArray
from ....model import Units


class Points(NamedTuple):
    """Points (N, D), NaN where missing, and what priors are in units of.

    t
        (N, D).
    location, scale
        Mean (D,) of the training points, and their overall standard deviation.
    """

    t: Float[AnyArray, "n d"]
    location: Float[AnyArray, " d"]
    scale: Float[AnyArray, ""]


def points_of(t: Float[np.ndarray, "n d"]) -> Points:
    """Return training points with their location and scale.

    Raises
    ------
    InputError
        If a bin is seen nowhere, or all points are the same.
    """
    if np.isnan(t).all(axis=0).any():
        raise InputError("points", "a bin is missing everywhere", "Leave it out")
    location = np.nanmean(t, axis=0, dtype=float)
    scale = np.sqrt(np.nanmean((t - location) ** 2, dtype=float))
    if not scale > 0:
        raise InputError("points", "they are all the same", "Give points that differ")
    return Points(t, location, np.asarray(scale))


@dataclass(frozen=True)
class PointData:
    """Points with their labels.

    points
        The arrays for the program.
    labels
        Names of the D bins.
    names
        Coordinates of the points, as the recordings have them.
    """

    points: Points
    labels: tuple[str, ...]
    names: tuple

    @property
    def data(self) -> tuple[Points]:
        """The arguments of the model's program."""
        return (self.points,)

    def observed(self) -> xr.Dataset:
        """Return what the model explains: ``t`` (point, bin)."""
        return xr.Dataset(
            {"t": (("point", "bin"), np.asarray(self.points.t))},
            {"point": list(self.names), "bin": list(self.labels)},
        )

    def constants(self) -> xr.Dataset:
        """Return location and scale of the points."""
        return xr.Dataset(
            {
                "location": ("bin", np.asarray(self.points.location)),
                "scale": float(self.points.scale),
            },
            {"bin": list(self.labels)},
        )

    def units(self) -> dict[str, Units]:
        """Return the units of ``t``: those of the recordings."""
        size = len(self.labels)
        return {"t": Units(np.zeros(size), np.ones(size))}


def prepare_points(recordings: xr.Dataset, trained: PointData | None) -> PointData:
    """Make ``t`` (point, bin) into arrays, in the units of the training points if there are any.

    Raises
    ------
    InputError
        If there is no such variable, or its bins are not those that trained.
    """
    if "t" not in recordings or recordings["t"].dims != ("point", "bin"):
        raise InputError("points", "there is no t (point, bin)", "Name the variable t")
    t = np.asarray(recordings["t"].values, dtype=float)
    labels = tuple(map(str, recordings["bin"].values))
    names = tuple(recordings["point"].values.tolist())
    if trained is None:
        return PointData(points_of(t), labels, names)
    if labels != trained.labels:
        raise InputError("points", "their bins are not those that trained", "Give the same bins")
    return PointData(trained.points._replace(t=t), labels, names)
