"""Multifactor tensor with Gaussian factors, its core integrated out.

Perera, Kudoh and Ikeuchi write motion segments as a tensor, position x people x task
(eq. 12): P = Q x_1 S_position x_2 S_people x_3 S_task. Here the position mode is that of
the singular value decomposition, cut to Q columns, and every other mode has full rank: its
factor matrix is [1, I], a constant beside one column a level. Written out, the segment n of
the levels l_1 .. l_M in Q coordinates is

    y_n = mean + sum_m effect^m[l_m(n)] + cell[l_1(n), .., l_M(n)] + repetition_n
    effect^m      flat                       one a person, one a task, ...
    cell          ~ N(0, share Sigma)        how this person does this task
    repetition    ~ N(0, (1 - share) Sigma)  how two repetitions of a cell differ
    Sigma         ~ InverseWishart(dof + Q - 1, scale I)

    log_odds = log(share / (1 - share)) ~ Normal(0, 1)
    log scale ~ Normal(0, 3)        segments are scaled to unit mean spread first
    log dof ~ Normal(log 10, 1.5)

Everything but the last three is integrated out: with K = share C + (1 - share) I, C_nn' = 1
where n and n' are of one cell, A the (N, R) design of the main effects, and G the residual
sum of squares Y^T (K^-1 - K^-1 A (A^T K^-1 A)^-1 A^T K^-1) Y,

    log p(Y) = - Q/2 (log |K| + log |A^T K^-1 A| - log |A^T A|) - Q (N - R)/2 log pi
               + nu/2 log |scale I| - (nu + N - R)/2 log |scale I + G|
               + log Gamma_Q((nu + N - R)/2) - log Gamma_Q(nu/2),    nu = dof + Q - 1.

Cells without segments take no part, so missing cells are integrated out; with one segment a
cell the data say nothing of `share`, and its prior decides.

What it says of new segments is in `bayesmotion.models.tensor_classes`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jax.scipy.special import multigammaln
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int
from numpyro import distributions as dist

from ..errors import InputError
from ..gp.linalg import AnyArray, cholesky, inverse_factor
from ..motion.segments import Body, Channels, Pace, Segmenting, segments

if TYPE_CHECKING:
    from .segment_training import SegmentTraining

SITES = ("log_odds", "log_scale", "log_dof")


class TensorData(NamedTuple):
    """Segments as the program sees them.

    y
        (N, Q) coordinates.
    design
        (N, R) of the main effects, of full column rank.
    same
        (N, N) 1 where two segments are of one cell.
    """

    y: Float[AnyArray, "n q"]
    design: Float[AnyArray, "n r"]
    same: Float[AnyArray, "n n"]


@dataclass(frozen=True)
class MultifactorTensor:
    """The model with its settings; see the module for the equations.

    Parameters
    ----------
    modes
        Labels that are the modes of the tensor beside position.
    rank
        Q, columns kept of the position mode: all that the segments span by default, for the
        prior of Sigma shrinks those that say little; never more than segments less one.
    """

    modes: tuple[str, ...] = ("subject", "task")
    rank: int | None = None
    name: ClassVar[str] = "tensor"

    def __post_init__(self) -> None:
        """Refuse a single mode, and a rank of nothing."""
        if len(self.modes) < 2 or (self.rank is not None and self.rank < 1):
            raise InputError(
                "tensor",
                f"modes {', '.join(self.modes)} and rank {self.rank}",
                "Give two modes or more beside position, and a rank of one or more",
            )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> "MultifactorTensor":
        """Make the model from its settings as plain values."""
        return cls(**{**settings, "modes": tuple(settings["modes"])})

    def prepare(
        self,
        motion: xr.Dataset,
        *,
        channels: Channels = "both",
        coefficients: int = 3,
        samples: int = 64,
        body: Body = "one",
        static: bool = True,
        pace: Pace = "time",
    ) -> "SegmentTraining":
        """Make clips into arrays, one segment each; keywords as of `Segmenting`."""
        from .segment_training import segment_training  # it needs the model in turn

        settings = Segmenting(channels, coefficients, samples, body, static, pace)
        return segment_training(segments(motion, settings), self.modes, self.rank)

    def initial_values(
        self, training: "SegmentTraining", seed: int, count: int
    ) -> list[dict[str, np.ndarray]]:
        """Give values of the sites to begin the search from: the first fixed, others random."""
        random = np.random.default_rng(seed)
        first = {name: np.asarray(value) for name, value in self.initial().items()}
        others = [
            {name: np.asarray(value + random.normal()) for name, value in first.items()}
            for _ in range(count - 1)
        ]
        return [first, *others]

    def program(self, data: TensorData) -> None:
        """The generative program, everything but three numbers integrated out."""
        priors = {
            "log_odds": dist.Normal(0.0, 1.0),
            "log_scale": dist.Normal(0.0, 3.0),
            "log_dof": dist.Normal(np.log(10.0), 1.5),
        }
        values = {name: jnp.asarray(numpyro.sample(name, d)) for name, d in priors.items()}
        numpyro.factor("y", log_marginal(data, **values))

    def initial(self) -> dict[str, float]:
        """Give values of the sites to start from."""
        return {"log_odds": 0.0, "log_scale": 0.0, "log_dof": float(np.log(10.0))}

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of the sites."""
        return dict.fromkeys(SITES, ()) | {"y": ("clip", "position")}

    def coords(self, training: "SegmentTraining") -> dict[str, list]:
        """Give the labels of the dimensions."""
        y = training.tensor.y
        return {
            "clip": training.segments["clip"].values.tolist(),
            "position": list(range(y.shape[1])),
        }


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

    Raises
    ------
    InputError
        If a mode has a single level, or there are no more segments than main effects.
    """
    design = main_effects(level, counts)
    if min(counts) < 2:
        raise InputError(
            "tensor", "a mode has a single level", "Give segments of two levels of every mode"
        )
    if len(y) <= design.shape[1] or np.linalg.matrix_rank(design) < design.shape[1]:
        raise InputError(
            "tensor",
            f"{len(y)} segments do not tell {design.shape[1]} main effects apart",
            "Give segments of more combinations of the levels",
        )
    same = (level[:, None] == level[None]).all(axis=2)
    return TensorData(y, design, same.astype(float))


def main_effects(level: Int[np.ndarray, "n m"], counts: Sequence[int]) -> Float[np.ndarray, "n r"]:
    """Give design rows: a constant, and for every mode L - 1 columns that sum to nothing.

    A new level (index L) has the mean of the known ones: zeros.
    """
    columns = [np.ones((len(level), 1))]
    for mode, count in enumerate(counts):
        coded = np.zeros((count + 1, count - 1))
        coded[: count - 1] = np.eye(count - 1)
        coded[count - 1] = -1.0
        columns.append(coded[level[:, mode]])
    return np.concatenate(columns, axis=1)


def log_marginal(
    data: TensorData, log_odds: ArrayLike, log_scale: ArrayLike, log_dof: ArrayLike
) -> Array:
    """Log density of the segments with all effects and Sigma integrated out."""
    y, design, same = data
    log_odds, log_scale, log_dof = (jnp.asarray(v) for v in (log_odds, log_scale, log_dof))
    (n, q), r = y.shape, design.shape[1]
    share = 1.0 / (1.0 + jnp.exp(-log_odds))
    L = cholesky(share * same + (1.0 - share) * jnp.eye(n))
    inverse = inverse_factor(L)
    white_y, white_a = inverse @ y, inverse @ design
    La = cholesky(white_a.T @ white_a)
    fitted = inverse_factor(La) @ (white_a.T @ white_y)
    residual = white_y.T @ white_y - fitted.T @ fitted
    Lg = cholesky(jnp.exp(log_scale) * jnp.eye(q) + residual)
    nu, free = jnp.exp(log_dof) + q - 1.0, n - r
    half = jnp.linalg.slogdet(jnp.asarray(design.T @ design))[1]
    determinants = 2.0 * (_log_diagonal(L) + _log_diagonal(La)) - half
    return (
        -0.5 * q * determinants
        - 0.5 * q * free * jnp.log(jnp.pi)
        + 0.5 * nu * q * log_scale
        - (nu + free) * _log_diagonal(Lg)
        + multigammaln(0.5 * (nu + free), q)
        - multigammaln(0.5 * nu, q)
    )


def _log_diagonal(L: AnyArray) -> AnyArray:
    return jnp.log(jnp.diagonal(L)).sum()
