"""Inputs and outputs as the relevance vector machine sees them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.spatial.distance import cdist

from ....errors import InputError
from ....gp.linalg import AnyArray
from ....model import Units


class Design(NamedTuple):
    """Basis functions Phi (N, B), and outputs y (N, M), NaN where missing."""

    phi: Float[AnyArray, "n b"]
    y: Float[AnyArray, "n m"]


def basis_functions(
    x: Float[np.ndarray, "n f"], centres: Float[np.ndarray, "b f"], length_scale: float
) -> Float[np.ndarray, "n one_b"]:
    """Return the constant and the Gaussians around `centres` at points x: (N, 1 + B)."""
    gaussians = np.exp(-0.5 / length_scale**2 * cdist(x, centres, "sqeuclidean"))
    return np.column_stack([np.ones(len(x)), gaussians])


@dataclass(frozen=True)
class RelevanceData:
    """Inputs and outputs with their labels.

    design
        The arrays for the program; outputs in units of the training outputs.
    x
        (N, F) the inputs.
    outputs
        Names of the outputs.
    scaling
        Of the outputs.
    frames
        Names of the points, as the recordings have them.
    clips
        (N,) the clip of each; None where points belong to none.
    """

    design: Design
    x: Float[np.ndarray, "n f"]
    outputs: tuple[str, ...]
    scaling: Units
    frames: tuple
    clips: np.ndarray | None

    @property
    def data(self) -> tuple[Design]:
        """The arguments of the model's program."""
        return (self.design,)

    def observed(self) -> xr.Dataset:
        """Return what the model explains: ``y`` (frame, output)."""
        return xr.Dataset(
            {"y": (("frame", "output"), np.asarray(self.design.y))},
            {"frame": list(self.frames), "output": list(self.outputs)},
        )

    def constants(self) -> xr.Dataset:
        """Return basis functions, and location and scale of the outputs."""
        return xr.Dataset(
            {
                "phi": (("frame", "basis"), np.asarray(self.design.phi)),
                "location": ("output", self.scaling.location),
                "scale": ("output", self.scaling.scale),
            },
            {"frame": list(self.frames), "output": list(self.outputs)},
        )

    def units(self) -> dict[str, Units]:
        """Return the units of ``y``."""
        return {"y": self.scaling}


def prepare_points(
    recordings: xr.Dataset, length_scale: float, trained: RelevanceData | None
) -> RelevanceData:
    """Make ``x`` (frame, feature) and ``y`` (frame, output) into arrays.

    Of new data y may be missing as a whole.

    Raises
    ------
    InputError
        If a variable is lacking or has other dimensions, an input is missing, or an output is
        seen nowhere or does not vary.
    """
    x = _variable(recordings, "x", ("frame", "feature"))
    if np.isnan(x).any():
        raise InputError("x", "an input is missing", "Leave its point out")
    frames = tuple(recordings["frame"].values.tolist())
    clips = np.asarray(recordings["clip"].values) if "clip" in recordings.coords else None
    if trained is None:
        y = _variable(recordings, "y", ("frame", "output"))
        scaling, outputs = _units_of(y), tuple(map(str, recordings["output"].values))
        centres = x
    else:
        scaling, outputs, centres = trained.scaling, trained.outputs, trained.x
        if x.shape[1] != centres.shape[1]:
            raise InputError("x", f"it has {x.shape[1]} features", f"Give {centres.shape[1]}")
        if "y" in recordings:
            _require_outputs(recordings, outputs)
            y = _variable(recordings.sel(output=list(outputs)), "y", ("frame", "output"))
        else:
            y = np.full((len(x), len(outputs)), np.nan)
    design = Design(
        basis_functions(x, centres, length_scale), (y - scaling.location) / scaling.scale
    )
    return RelevanceData(design, x, outputs, scaling, frames, clips)


def _variable(recordings: xr.Dataset, name: str, dims: tuple[str, str]) -> np.ndarray:
    if name not in recordings or recordings[name].dims != dims:
        raise InputError("points", f"there is no {name} {dims}", "Name the variables x, y")
    return np.asarray(recordings[name].values, dtype=float)


def _require_outputs(recordings: xr.Dataset, outputs: tuple[str, ...]) -> None:
    lacking = sorted(set(outputs) - set(map(str, recordings["output"].values)))
    if lacking:
        raise InputError("y", f"it lacks {', '.join(lacking)}", "Give the outputs that trained")


def _units_of(y: Float[np.ndarray, "n m"]) -> Units:
    """Return mean and standard deviation of every output."""
    if np.isnan(y).all(axis=0).any():
        raise InputError("outputs", "one of them is missing everywhere", "Leave it out")
    scale = np.nanstd(y, axis=0)
    if not (scale > 0).all():
        raise InputError("outputs", "one of them does not vary", "Leave it out")
    return Units(np.nanmean(y, axis=0), scale)
