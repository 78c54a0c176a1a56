"""Motion segments made into what the multifactor tensor is given.

Vectors become coordinates of the position mode of the tensor: the singular vectors of the
training segments, scaled together so that the mean spread of a coordinate is one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ..errors import InputError
from .multifactor_tensor import TensorData, tensor_data


@dataclass(frozen=True)
class PositionMode:
    """The position mode: how vectors become coordinates.

    mean
        (D,) of the training segments.
    basis
        (D, Q) orthonormal columns of the singular value decomposition.
    spread
        Mean standard deviation of the training coordinates; coordinates are divided by it.
    """

    mean: Float[np.ndarray, " d"]
    basis: Float[np.ndarray, "d q"]
    spread: float

    def coordinates(self, x: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n q"]:
        """Give the coordinates of vectors."""
        return (x - self.mean) @ self.basis / self.spread

    def vectors(self, y: Float[np.ndarray, "n q"]) -> Float[np.ndarray, "n d"]:
        """Give the vectors of coordinates."""
        return self.mean + self.spread * y @ self.basis.T


@dataclass(frozen=True)
class SegmentTraining:
    """Training segments as the tensor sees them.

    position
        The position mode.
    levels
        For each mode the names of the known levels.
    level
        (N, M) levels of the segments.
    tensor
        The arrays for the program.
    segments
        The segments as vectors, with their labels.
    """

    position: PositionMode
    levels: dict[str, list[str]]
    level: Int[np.ndarray, "n m"]
    tensor: TensorData
    segments: xr.DataArray

    @property
    def data(self) -> tuple[TensorData]:
        """The arguments of the model's program."""
        return (self.tensor,)

    def observed(self) -> xr.Dataset:
        """What the model explains: coordinates ``y`` (clip, position)."""
        clip = self.segments["clip"].values
        labels = {mode: ("clip", self.segments[mode].values) for mode in self.levels}
        return xr.Dataset({"y": (("clip", "position"), np.asarray(self.tensor.y))},
                          {"clip": clip, **labels})  # fmt: skip

    def constants(self) -> xr.Dataset:
        """What brings coordinates back to vectors."""
        return xr.Dataset(
            {
                "mean": ("entry", self.position.mean),
                "basis": (("entry", "position"), self.position.basis),
                "spread": ((), self.position.spread),
            }
        )

    @property
    def counts(self) -> list[int]:
        """Number of known levels of every mode."""
        return [len(names) for names in self.levels.values()]


def segment_training(
    segments: xr.DataArray, modes: Sequence[str], rank: int | None
) -> SegmentTraining:
    """Make segments with known labels into arrays.

    Parameters
    ----------
    segments
        As `bayesmotion.motion.segments.segments` gives them, with the modes as labels.
    modes
        The labels that are modes.
    rank
        Columns kept of the position mode, all by default.

    Raises
    ------
    InputError
        If a label is unknown, an entry is missing, or there are too few segments.
    """
    levels, level = _levels(segments, modes)
    x = vectors(segments)
    position = position_mode(x, rank)
    data = tensor_data(position.coordinates(x), level, [len(names) for names in levels.values()])
    return SegmentTraining(position, levels, level, data, segments)


def position_mode(x: Float[np.ndarray, "n d"], rank: int | None = None) -> PositionMode:
    """Give the position mode of training vectors, at most of rank N - 1, by default all."""
    mean = x.mean(axis=0)
    _, _, right = np.linalg.svd(x - mean, full_matrices=False)
    most = min(len(x) - 1, len(right))
    basis = right[: most if rank is None else min(rank, most)].T
    return PositionMode(mean, basis, float(((x - mean) @ basis).std(axis=0).mean()))


def vectors(segments: xr.DataArray) -> Float[np.ndarray, "n d"]:
    """Give segments as rows.

    Raises
    ------
    InputError
        If an entry is missing.
    """
    rows = segments.values.reshape(segments.sizes["clip"], -1)
    bad = ~np.isfinite(rows).all(axis=1)
    if bad.any():
        raise InputError(
            f"clip {str(segments['clip'].values[bad][0])!r}",
            "its segment has missing entries",
            "Leave the clip out",
        )
    return rows


def _levels(
    segments: xr.DataArray, modes: Sequence[str]
) -> tuple[dict[str, list[str]], Int[np.ndarray, "n m"]]:
    """Name the levels of every mode, and give each segment's."""
    levels: dict[str, list[str]] = {}
    columns = []
    for mode in modes:
        if mode not in segments.coords or "" in segments[mode].values.tolist():
            raise InputError(
                f"segments, label {mode!r}",
                "it is unknown for some clip",
                f"Give the {mode} of every training clip",
            )
        values = segments[mode].values.tolist()
        levels[mode] = sorted(set(values))
        columns.append([levels[mode].index(value) for value in values])
    return levels, np.array(columns).T
