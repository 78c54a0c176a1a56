"""Bayesian Tucker decomposition of a tensor with missing cells.

    y[d, l_1, .., l_M] ~ Normal(T[d, l_1, .., l_M], noise[joint of d])
    T = core x_0 S_0 x_1 S_1 .. x_M S_M,     S_0 the position mode, S_1 .. S_M the styles

``priors="ard"``: every entry of S_m is Normal(0, 1). With ``constant=True`` every style mode
has a first column of ones beside its S_m, so that with L_m - 1 columns the additive model
(a mean, an effect of each person, an effect of each task) is a special case. Each column r
of a mode has a precision, and a column that explains nothing is shrunk away (automatic
choice of ranks); so has each order of the core, o = the number of style modes whose column
is not the constant (0 the mean, 1 main effects, 2 and more interactions):

    precision_m[r], order[o] ~ Gamma(1.5, 0.5)
    core[r_0, .., r_M] ~ Normal(0, (order[o] prod_m precision_m[r_m])^(-1/2))
    noise[j] ~ LogNormal(log 0.3, 1)     entries are scaled to unit spread first

``priors="flat"``: all flat and one noise for all joints; the mode is the least squares
solution (`bayesmotion.models.hosvd.alternating` on complete data).

Given the factors entries are independent, so missing cells (NaN) leave the likelihood.
Factors are known up to a rotation of each mode; T is not.
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Float, Int
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ..errors import InputError
from ..gp.linalg import AnyArray

AXES = "abcdefghij"


class Cells(NamedTuple):
    """A tensor as the program sees it.

    y
        (D, L_1, .., L_M), zero where missing.
    seen
        The same shape, False where missing.
    joint
        (D,) index of the joint of every position.
    """

    y: AnyArray
    seen: AnyArray
    joint: AnyArray


@dataclass(frozen=True)
class BayesianTucker:
    """The model with its settings; see the module for the equations.

    Parameters
    ----------
    ranks
        Columns of every mode, position first (constants not counted).
    priors
        ``ard`` or ``flat``.
    constant
        Whether each style mode has a column of ones.
    joints
        Number of joints, each with a noise of its own.
    """

    ranks: tuple[int, ...]
    priors: Literal["ard", "flat"] = "ard"
    constant: bool = True
    joints: int = 1
    name = "tucker"

    def program(self, cells: Cells) -> None:
        """The generative program."""
        shape = cells.y.shape
        if len(shape) != len(self.ranks):
            raise InputError(
                "tucker",
                f"{len(self.ranks)} ranks for a tensor of {len(shape)} modes",
                "Give a rank for every mode, position first",
            )
        flat = self.priors == "flat"
        normal = _flat if flat else lambda size: dist.Normal(0.0, 1.0).expand(size).to_event()
        factors = [
            jnp.asarray(numpyro.sample(f"factor_{m}", normal((length, rank))))
            for m, (length, rank) in enumerate(zip(shape, self.ranks, strict=True))
        ]
        size = tuple(rank + self._constants(m) for m, rank in enumerate(self.ranks))
        if flat:
            core = jnp.asarray(numpyro.sample("core", _flat(size)))
            log_noise = jnp.asarray(numpyro.sample("log_noise", _flat((1,))))
            sd = jnp.broadcast_to(jnp.exp(log_noise), (shape[0],))
        else:
            core = jnp.asarray(
                numpyro.sample("core", dist.Normal(0.0, self._core_scale(size)).to_event())
            )
            prior = dist.Normal(np.log(0.3), 1.0).expand((self.joints,)).to_event()
            sd = jnp.exp(jnp.asarray(numpyro.sample("log_noise", prior)))[cells.joint]
        mean = multiply(core, [self._with_constant(m, f) for m, f in enumerate(factors)])
        sd = sd.reshape(-1, *(1 for _ in shape[1:]))
        with numpyro.handlers.mask(mask=cells.seen):
            numpyro.sample("y", dist.Normal(mean, sd), obs=cells.y)

    def tensor(self, values: dict[str, Any]) -> np.ndarray:
        """Give T of site values."""
        factors = [
            self._with_constant(m, jnp.asarray(values[f"factor_{m}"]))
            for m in range(len(self.ranks))
        ]
        return np.asarray(multiply(jnp.asarray(values["core"]), factors))

    def initial_values(self, cells: Cells, seed: int, count: int) -> dict[str, np.ndarray]:
        """Give random starting values, with a leading axis over `count` starts."""
        random = np.random.default_rng(seed)
        size = tuple(rank + self._constants(m) for m, rank in enumerate(self.ranks))
        first = {
            f"factor_{m}": random.normal(size=(count, length, rank)) / np.sqrt(rank)
            for m, (length, rank) in enumerate(zip(cells.y.shape, self.ranks, strict=True))
        }
        first["core"] = 0.3 * random.normal(size=(count, *size))
        noises = 1 if self.priors == "flat" else self.joints
        first["log_noise"] = np.full((count, noises), np.log(0.5))
        if self.priors == "ard":
            first |= {f"log_precision_{m}": np.zeros((count, n)) for m, n in enumerate(size)}
            if self.constant:
                first["log_order"] = np.zeros((count, len(size)))
        return first

    def _core_scale(self, size: tuple[int, ...]) -> AnyArray:
        """Sample the precisions (by their logarithms) and give the core's scales."""
        log_precision: AnyArray = jnp.zeros(())
        for mode, count in enumerate(size):
            log = jnp.asarray(numpyro.sample(f"log_precision_{mode}", log_gamma(1.5, 0.5, count)))
            log_precision = log_precision[..., None] + log
        if self.constant:
            orders = self._orders(size)
            prior = log_gamma(1.5, 0.5, int(orders.max()) + 1)
            log = jnp.asarray(numpyro.sample("log_order", prior))
            log_precision = log_precision + log[orders]
        return jnp.exp(-0.5 * log_precision)

    def _orders(self, size: tuple[int, ...]) -> np.ndarray:
        """Count for every entry of the core the style modes whose column is not the constant."""
        grid = np.indices(size[1:])
        return np.broadcast_to((grid > 0).sum(axis=0), size)

    def _constants(self, mode: int) -> int:
        return int(self.constant and mode > 0)

    def _with_constant(self, mode: int, factor: AnyArray) -> AnyArray:
        if not self._constants(mode):
            return factor
        return jnp.concatenate([jnp.ones((factor.shape[0], 1)), factor], axis=1)


def cells_of(tensor: np.ndarray, joint: Int[np.ndarray, " d"]) -> Cells:
    """Make the program's arrays.

    Parameters
    ----------
    tensor
        (D, L_1, .., L_M), NaN where a cell or a joint of it is missing.
    joint
        Index of the joint of every position, from 0 without gaps.

    Raises
    ------
    InputError
        If nothing is there, or the joints do not fit.
    """
    seen = np.isfinite(tensor)
    if not seen.any() or len(joint) != len(tensor) or len(np.unique(joint)) != joint.max() + 1:
        raise InputError(
            "tucker",
            f"a tensor {tensor.shape} with {len(joint)} joints holds nothing to learn from",
            "Give some cells, and for every position the number of its joint",
        )
    return Cells(np.where(seen, tensor, 0.0), seen, joint)


def multiply(core: AnyArray, factors: list[AnyArray]) -> AnyArray:
    """Multiply a core with a matrix on every mode."""
    modes = len(factors)
    inner, outer = AXES[:modes], AXES[:modes].upper()
    terms = [o + i for o, i in zip(outer, inner, strict=True)]
    return jnp.einsum(f"{inner},{','.join(terms)}->{outer}", core, *factors, optimize=True)


def additive(tensor: Float[np.ndarray, "d i j"]) -> Float[np.ndarray, "d i j"]:
    """Give the least squares person-plus-task mean, which knows no interaction.

    Raises
    ------
    InputError
        If a person or a task has no cell at all.
    """
    seen = np.isfinite(tensor).all(axis=0)
    if not seen.any(axis=0).all() or not seen.any(axis=1).all():
        raise InputError("tensor", "a level has no cell", "Leave the level out")
    rows, columns = np.nonzero(seen)
    people, tasks = seen.shape
    design = np.zeros((len(rows), people + tasks))
    design[np.arange(len(rows)), rows] = 1.0
    design[np.arange(len(rows)), people + columns] = 1.0
    effects = np.linalg.lstsq(design, tensor[:, rows, columns].T, rcond=None)[0].T
    return effects[:, :people, None] + effects[:, None, people:]


def _flat(size: tuple[int, ...]) -> dist.Distribution:
    return dist.ImproperUniform(constraints.real, (), size)


def log_gamma(shape: float, rate: float, count: int) -> dist.Distribution:
    """Logarithm of a Gamma variable: its density has a mode on the whole line."""
    base = dist.Gamma(shape, rate).expand((count,))
    inverse = dist.transforms.ExpTransform().inv
    return dist.TransformedDistribution(base, inverse).to_event()
