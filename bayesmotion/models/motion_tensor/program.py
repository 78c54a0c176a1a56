"""Motion tensor with Gaussian factors, its core integrated out.

Perera, Kudoh and Ikeuchi write motion segments as a tensor, position x people x task
(eq. 12): P = Q x_1 S_position x_2 S_people x_3 S_task. Here the position mode is that of
the singular value decomposition, cut to Q columns, and every other mode has full rank: its
factor matrix is [1, I], a constant beside one column a level. Written out, the segment n of
the levels l_1 .. l_M in Q coordinates is

    y_n = mean + sum_m effect^m[l_m(n)] + cell[l_1(n), .., l_M(n)] + repetition_n
    mean, effect^m ~ N(0, effect_sd^2 Sigma)     one a person, one a task, ...
    cell           ~ N(0, share Sigma)           how this person does this task
    repetition     ~ N(0, (1 - share) Sigma)     how two repetitions of a cell differ
    Sigma          ~ InverseWishart(dof + Q - 1, scale I)

    log_odds = log(share / (1 - share)) ~ Normal(0, 1)
    log_scale ~ Normal(0, 3)         segments are scaled to unit mean standard deviation first
    log_dof ~ Normal(log 10, 1.5)

Everything but the last three is integrated out: with A the design of mean and effects and
C_nn' = 1 where n and n' are of one cell, the rows have the covariance

    K = effect_sd^2 A A^T + share C + (1 - share) I

and y is matrix-t (`matrix_t`). Cells without segments take no part, so missing cells are
integrated out; with one segment a cell the data say little of `share`, and its prior decides.

What it says of new segments is in `classes`, and over the draws of a fit in `levels`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Array, Bool, Float
from numpyro import distributions as dist

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import About, SBCCase, Values
from ...motion.dataset import label_names
from ...motion.io.recordings import read_clips
from ...motion.segments import Segmenting, body_of, segments
from .classes import (
    NewSegmentsT,
    TrainedTensor,
    class_log_density,
    class_log_weight,
    trained_tensor,
)
from .data import NewSegments, NewTensorData, TensorData, TensorTraining, tensor_training
from .data import new_segments as new_segments_of
from .example import example
from .levels import cell, level_log_densities
from .matrix_t import MatrixT, Rows, leave_one_out, rows
from .prediction import SegmentPredictive
from .sbc import small_case

SITES = ("log_odds", "log_scale", "log_dof")


@dataclass(frozen=True)
class MotionTensor:
    """The model with its settings; see the module for the equations.

    Parameters
    ----------
    modes
        Labels that are the modes of the tensor beside position.
    rank
        Q, columns kept of the position mode: all that the segments span by default, for the
        prior of Sigma shrinks those that say little; never more than segments less one.
    effect_sd
        Prior standard deviation of mean and main effects, where what repetitions and cells
        differ by has one. Wide: effects are learned level by level.
    segmenting
        How recordings become vectors.
    """

    modes: tuple[str, ...] = ("subject", "task")
    rank: int | None = None
    effect_sd: float = 10.0
    segmenting: Segmenting = field(default_factory=Segmenting)
    name: ClassVar[str] = "motion_tensor"
    about: ClassVar[About] = About(
        "Perera, Kudoh and Ikeuchi 2009", "clips with joint angles, each one segment of a task"
    )

    def __post_init__(self) -> None:
        """Refuse a single mode, a rank of nothing, and effects without width."""
        if len(self.modes) < 2 or (self.rank is not None and self.rank < 1):
            raise InputError(
                "motion tensor",
                f"modes {', '.join(self.modes)} and rank {self.rank}",
                "Give two modes or more beside position, and a rank of one or more",
            )
        if not self.effect_sd > 0:
            raise InputError("motion tensor", f"effect_sd {self.effect_sd}", "Give more than 0")

    read = staticmethod(read_clips)

    @classmethod
    def settings_for(cls, recordings: xr.Dataset) -> dict[str, Any]:
        """Return the modes: all labels of the recordings."""
        return {"modes": tuple(label_names(recordings))}

    @classmethod
    def example(cls, seed: int = 0) -> tuple["MotionTensor", xr.Dataset]:
        """Return a small model, and clips of three people who do two tasks, three times each."""
        return cls(segmenting=Segmenting("positions", coefficients=2)), example(seed)

    def prepare(
        self, recordings: xr.Dataset, trained: TensorTraining | None = None
    ) -> TensorTraining | NewTensorData:
        """Make clips into arrays, one segment each.

        Parameters
        ----------
        recordings
            Clips with joint angles, NaN where missing. For training every clip has a label
            of every mode; of new clips a missing label is unknown.
        trained
            The training clips, where `recordings` are new ones.

        Raises
        ------
        InputError
            If skeletons differ in their joints, a training label is unknown, or fewer than
            two training segments are seen.
        """
        if trained is not None:
            return new_segments_of(self.segments(recordings, trained), trained)
        body = body_of(recordings)
        made = segments(recordings, self.segmenting, body)
        return tensor_training(made, self.modes, self.rank, body)

    def segments(self, recordings: xr.Dataset, training: TensorTraining) -> xr.DataArray:
        """Return clips as segments, on the body of training."""
        return segments(recordings, self.segmenting, training.body)

    def without(self, training: TensorTraining, held: Bool[np.ndarray, " n"]) -> TensorTraining:
        """Return the training data of the other segments."""
        return tensor_training(training.segments[~held], self.modes, self.rank, training.body)

    def level_log_densities(
        self, training: TensorTraining, segments: xr.DataArray, values: Mapping[str, AnyArray]
    ) -> Float[Array, "s n c"]:
        """Return the log density of segments for every draw and combination of levels."""
        return level_log_densities(self, training, segments, values)

    def cell(
        self, training: TensorTraining, levels: Mapping[str, str], values: Mapping[str, AnyArray]
    ) -> xr.DataArray:
        """Return the segment of a combination of known levels; see `levels.cell`."""
        return cell(self, training, levels, values)

    def program(self, data: Any, trained: TrainedTensor | None = None) -> None:
        """The generative program of `TensorData`, or given `trained` of `NewSegments`."""
        if trained is not None:
            with numpyro.plate("clip", data.y.shape[0]):
                numpyro.sample("y", NewSegmentsT(trained, data), obs=data.y)
            return
        priors = {
            "log_odds": dist.Normal(0.0, 1.0),
            "log_scale": dist.Normal(0.0, 3.0),
            "log_dof": dist.Normal(np.log(10.0), 1.5),
        }
        values = {name: jnp.asarray(numpyro.sample(name, d)) for name, d in priors.items()}
        scale, dof = jnp.exp(values["log_scale"]), jnp.exp(values["log_dof"])
        covariance = self._covariance(data, values)
        numpyro.sample("y", MatrixT(covariance, scale, dof, data.y.shape[1]), obs=data.y)

    def initial_values(
        self, data: Any, seed: int, count: int, trained: TrainedTensor | None = None
    ) -> list[dict[str, np.ndarray]]:
        """Return values to begin the search from: the first fixed, others random about it."""
        if trained is not None:
            return [{}]
        random = np.random.default_rng(seed)
        first = {"log_odds": 0.0, "log_scale": 0.0, "log_dof": float(np.log(10.0))}
        sizes = [0.0, *np.ones(count - 1)]
        return [
            {name: np.asarray(value + size * random.normal()) for name, value in first.items()}
            for size in sizes
        ]

    def condition(self, arrays: TensorData, values: Mapping[str, AnyArray]) -> TrainedTensor:
        """Return the densities of all combinations of levels, for one draw."""
        share = jax.nn.sigmoid(jnp.asarray(values["log_odds"]))
        width = jnp.full(arrays.design.shape[1], self.effect_sd**2)
        return trained_tensor(arrays, self._rows(arrays, values), share, width)

    def predict(
        self,
        trained: TrainedTensor,
        arrays: NewSegments | TensorData,
        values: Mapping[str, AnyArray],
    ) -> dict[str, SegmentPredictive]:
        """Return other repetitions of new segments; `values` is empty."""
        weight = class_log_weight(trained, arrays) + class_log_density(trained, arrays)
        return {"y": SegmentPredictive(trained, arrays, weight)}

    def identified(self, arrays: TensorData, values: Mapping[str, AnyArray]) -> Values:
        """Return the share, the sites of Sigma's prior, and the size of E[Sigma | y].

        ``log_sd`` is the logarithm of the root mean square of the standard deviations.
        """
        known = self._rows(arrays, values)
        q = known.matrix.shape[0]
        mean = jnp.trace(known.matrix) / (q * jnp.maximum(known.dof - 2.0, 1.0))
        own = {name: jnp.asarray(values[name]) for name in SITES}
        return own | {"log_sd": 0.5 * jnp.log(mean)}

    def pointwise(self, arrays: TensorData, values: Mapping[str, AnyArray]) -> Float[Array, " n"]:
        """Return ``log p(y_n | all other segments)`` of every segment, exactly."""
        return leave_one_out(self._rows(arrays, values))

    def points(self, data: TensorTraining) -> dict[str, tuple[str, np.ndarray]]:
        """Return the clip and the labels of every segment."""
        names = ("clip", *self.modes)
        return {name: ("point", data.segments[name].values) for name in names}

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the dimensions of sites and identified quantities."""
        return dict.fromkeys((*SITES, "log_sd"), ()) | {"y": ("clip", "position")}

    def coords(self, data: TensorTraining) -> dict[str, list]:
        """Return the labels of the dimensions."""
        y = data.tensor.y
        return {
            "clip": data.segments["clip"].values.tolist(),
            "position": list(range(y.shape[1])),
        }

    def sbc_case(self) -> tuple[SBCCase, TensorData]:
        """Return this model of three people, two tasks and three repetitions of a cell."""
        return small_case(self)

    def _covariance(self, data: TensorData, values: Mapping[str, AnyArray]) -> Float[Array, "n n"]:
        """Return K."""
        share = jax.nn.sigmoid(jnp.asarray(values["log_odds"]))
        cell = (data.level[:, None] == data.level[None]).all(axis=2)
        effects = self.effect_sd**2 * (jnp.asarray(data.design) @ data.design.T)
        return effects + share * cell + (1.0 - share) * jnp.eye(len(cell))

    def _rows(self, data: TensorData, values: Mapping[str, AnyArray]) -> Rows:
        scale, dof = (jnp.exp(jnp.asarray(values[name])) for name in ("log_scale", "log_dof"))
        return rows(data.y, self._covariance(data, values), scale, dof)
