"""Motion segments made into what the motion tensor's program is given.

Vectors become coordinates of the position mode of the tensor: the singular vectors of the
training segments, scaled together so that the mean standard deviation of a coordinate is one.

What is missing of a segment is NaN in its vector. The position mode spans the training
segments, so that the channels that are seen tell its coordinates by least squares, as far as
they do (`PositionMode.seen`): directions that are mostly in the missing channels are
unknown. A training segment with unknown directions is left out, which integrates all of it
out; of a new segment the directions that are seen are kept.
"""

import itertools
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ...errors import InputError, MotionWarning
from ...gp.linalg import AnyArray
from ...model import Units
from ...motion.skeleton import Skeleton

UNKNOWN = -1
# A direction is seen where the seen channels hold at least this share of its length.
SEEN = 0.5


class TensorData(NamedTuple):
    """Training segments as the program sees them, and all combinations of levels.

    y
        (N, Q) coordinates.
    design
        (N, R) of the main effects: a constant, and for every level of every mode a column
        that is 1 for its segments.
    level
        (N, M) index of the level of every mode.
    mode
        (M, R) 1 where a column is of a mode.
    class_level
        (C, M) levels of every combination, the number of known levels for a new one.
    class_design
        (C, R) its main effects: a new level has the mean of the known ones.
    seen
        None: of segments that are here all is seen.
    """

    y: Float[AnyArray, "n q"]
    design: Float[AnyArray, "n r"]
    level: Int[AnyArray, "n m"]
    mode: Float[AnyArray, "m r"]
    class_level: Int[AnyArray, "c m"]
    class_design: Float[AnyArray, "c r"]
    seen: None = None


class NewSegments(NamedTuple):
    """New segments as the program sees them.

    y
        (N, Q) coordinates, zero along unknown directions.
    seen
        (N, Q, Q) projection on the seen directions; None where all are seen.
    level
        (N, M) index of the level; `UNKNOWN`, or the number of known levels for a new one.
    """

    y: Float[AnyArray, "n q"]
    seen: Float[AnyArray, "n q q"] | None
    level: Int[AnyArray, "n m"]


@dataclass(frozen=True)
class PositionMode:
    """The position mode: how vectors become coordinates.

    mean
        (D,) of the training segments.
    basis
        (D, Q) orthonormal columns of the singular value decomposition.
    scale
        Mean standard deviation of the training coordinates, by which they are divided.
    """

    mean: Float[np.ndarray, " d"]
    basis: Float[np.ndarray, "d q"]
    scale: float

    def coordinates(self, x: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n q"]:
        """Return the coordinates of complete vectors."""
        return (x - self.mean) @ self.basis / self.scale

    def vectors(self, y: Float[np.ndarray, "n q"]) -> Float[np.ndarray, "n d"]:
        """Return the vectors of coordinates."""
        return self.mean + self.scale * y @ self.basis.T

    def seen(
        self, x: Float[np.ndarray, "n d"]
    ) -> tuple[Float[np.ndarray, "n q"], Float[np.ndarray, "n q q"]]:
        """Return coordinates of vectors with missing entries, and the directions seen.

        Returns
        -------
        Coordinates, zero along unknown directions, and projections on the seen ones.
        """
        y = np.zeros((len(x), self.basis.shape[1]))
        seen = np.zeros((len(x), *2 * y.shape[1:]))
        for row, there in enumerate(np.isfinite(x)):
            if there.all():
                y[row], seen[row] = self.coordinates(x[row : row + 1])[0], np.eye(y.shape[1])
                continue
            u, size, right = np.linalg.svd(self.basis[there], full_matrices=False)
            kept = size > SEEN
            if kept.all() and len(size) == y.shape[1]:
                right_kept, seen[row] = right, np.eye(y.shape[1])
            else:
                right_kept = right[kept]
                seen[row] = right_kept.T @ right_kept
            gap = (x[row, there] - self.mean[there]) / self.scale
            y[row] = right_kept.T @ ((u[:, kept].T @ gap) / size[kept])
        return y, seen


@dataclass(frozen=True)
class TensorTraining:
    """Training segments as the tensor sees them.

    position
        The position mode.
    levels
        For each mode the names of the known levels.
    tensor
        The arrays for the program.
    segments
        The segments that are in them, as vectors with their labels.
    body
        The skeleton that all were put on; None where vectors were given.
    """

    position: PositionMode
    levels: dict[str, list[str]]
    tensor: TensorData
    segments: xr.DataArray
    body: Skeleton | None = None

    @property
    def data(self) -> tuple[TensorData]:
        """The arguments of the model's program."""
        return (self.tensor,)

    def observed(self) -> xr.Dataset:
        """Return what the model explains: coordinates ``y`` (clip, position)."""
        return _observed(np.asarray(self.tensor.y), self.segments, self.levels)

    def constants(self) -> xr.Dataset:
        """Return what brings coordinates back to vectors."""
        return _constants(self.position)

    def units(self) -> dict[str, Units]:
        """Return the units of ``y``: lengths along the columns of the basis."""
        return _units(self.position)

    @property
    def counts(self) -> list[int]:
        """Number of known levels of every mode."""
        return [len(names) for names in self.levels.values()]


@dataclass(frozen=True)
class NewTensorData:
    """New segments in the coordinates of the training ones.

    position, levels
        Of the training.
    new
        The arrays for the program.
    segments
        The segments as vectors, with the labels they have.
    """

    position: PositionMode
    levels: dict[str, list[str]]
    new: NewSegments
    segments: xr.DataArray

    @property
    def data(self) -> tuple[NewSegments]:
        """The arguments of the model's program."""
        return (self.new,)

    def observed(self) -> xr.Dataset:
        """Return the coordinates ``y`` (clip, position), NaN where a direction is unknown."""
        y = np.array(self.new.y)
        if self.new.seen is not None:
            whole = np.diagonal(np.asarray(self.new.seen), axis1=1, axis2=2) > 1.0 - 1e-9
            y[~whole] = np.nan
        return _observed(y, self.segments, self.levels)

    def constants(self) -> xr.Dataset:
        """Return what brings coordinates back to vectors."""
        return _constants(self.position)

    def units(self) -> dict[str, Units]:
        """Return the units of ``y``: lengths along the columns of the basis."""
        return _units(self.position)


def tensor_training(
    segments: xr.DataArray, modes: Sequence[str], rank: int | None, body: Skeleton | None = None
) -> TensorTraining:
    """Make segments with known labels into arrays.

    Parameters
    ----------
    segments
        As `bayesmotion.motion.segments.segments` makes them, with the modes as labels.
    modes
        The labels that are modes.
    rank
        Columns kept of the position mode, all by default.
    body
        The skeleton they were put on.

    Raises
    ------
    InputError
        If a label is unknown, or fewer than two segments are seen.
    """
    x = vectors(segments)
    whole = np.isfinite(x).all(axis=1)
    if whole.sum() < 2:
        raise InputError(
            "motion tensor", "fewer than two segments have no gap", "Give more recordings"
        )
    position = position_mode(x[whole], rank)
    y, seen = position.seen(x)
    kept = np.trace(seen, axis1=1, axis2=2) > y.shape[1] - 0.5
    for clip in segments["clip"].values[~kept]:
        warnings.warn(
            f"clip {str(clip)!r}: what is seen of it does not tell its coordinates; it is left out",
            MotionWarning,
            stacklevel=2,
        )
    levels, level = _levels(segments[kept], modes)
    return TensorTraining(position, levels, tensor_data(y[kept], level, _counts(levels)),
                          segments[kept], body)  # fmt: skip


def new_segments(segments: xr.DataArray, training: TensorTraining) -> NewTensorData:
    """Make new segments into arrays, in the coordinates and levels of the training.

    A label that is not there or empty is unknown; one that the training has not is new.
    """
    x = vectors(segments)
    there = np.isfinite(x)
    position = training.position
    if there.all():
        y, seen = position.coordinates(x), None
    else:
        y, seen = position.seen(x)
    columns = [
        [_index(known, str(value)) for value in segments[mode].values]
        if mode in segments.coords
        else [UNKNOWN] * len(x)
        for mode, known in training.levels.items()
    ]
    arrays = NewSegments(y, seen, np.array(columns, dtype=int).T.reshape(len(x), len(columns)))
    return NewTensorData(position, training.levels, arrays, segments)


def tensor_data(
    y: Float[np.ndarray, "n q"], level: Int[np.ndarray, "n m"], counts: Sequence[int]
) -> TensorData:
    """Make the program's arrays.

    Parameters
    ----------
    y
        Coordinates of the segments.
    level
        Index of the level of every mode.
    counts
        Number of levels of every mode.
    """
    grid = np.array(list(itertools.product(*(range(count + 1) for count in counts))))
    mode = np.zeros((len(counts), 1 + sum(counts)))
    for m, count in enumerate(counts):
        first = 1 + sum(counts[:m])
        mode[m, first : first + count] = 1.0
    return TensorData(
        y, main_effects(level, counts), level, mode, grid, main_effects(grid, counts)
    )  # fmt: skip


def main_effects(level: Int[np.ndarray, "n m"], counts: Sequence[int]) -> Float[np.ndarray, "n r"]:
    """Return design rows; a new level (index L) has the mean of the known ones."""
    columns = [np.ones((len(level), 1))]
    for mode, count in enumerate(counts):
        coded = np.concatenate([np.eye(count), np.full((1, count), 1.0 / count)])
        columns.append(coded[level[:, mode]])
    return np.concatenate(columns, axis=1)


def position_mode(x: Float[np.ndarray, "n d"], rank: int | None = None) -> PositionMode:
    """Return the position mode of training vectors, at most of rank N - 1, by default all."""
    mean = x.mean(axis=0)
    _, _, right = np.linalg.svd(x - mean, full_matrices=False)
    most = min(len(x) - 1, len(right))
    basis = right[: most if rank is None else min(rank, most)].T
    return PositionMode(mean, basis, float(((x - mean) @ basis).std(axis=0).mean()))


def vectors(segments: xr.DataArray) -> Float[np.ndarray, "n d"]:
    """Return segments as rows."""
    return segments.values.reshape(segments.sizes["clip"], -1).astype(float)


def _counts(levels: Mapping[str, Sequence[str]]) -> list[int]:
    return [len(names) for names in levels.values()]


def _index(known: Sequence[str], value: str) -> int:
    if value == "":
        return UNKNOWN
    return known.index(value) if value in known else len(known)


def _levels(
    segments: xr.DataArray, modes: Sequence[str]
) -> tuple[dict[str, list[str]], Int[np.ndarray, "n m"]]:
    """Name the levels of every mode, and tell each segment's."""
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


def _observed(
    y: Float[np.ndarray, "n q"], segments: xr.DataArray, levels: Mapping[str, Sequence[str]]
) -> xr.Dataset:
    labels = {m: ("clip", segments[m].values) for m in levels if m in segments.coords}
    return xr.Dataset({"y": (("clip", "position"), y)}, {"clip": segments["clip"].values, **labels})


def _constants(position: PositionMode) -> xr.Dataset:
    return xr.Dataset(
        {
            "mean": ("entry", position.mean),
            "basis": (("entry", "position"), position.basis),
            "scale": ((), position.scale),
        }
    )


def _units(position: PositionMode) -> dict[str, Units]:
    q = position.basis.shape[1]
    return {"y": Units(np.zeros(q), np.full(q, position.scale))}
