"""Bayesian Tucker decomposition with its core integrated out: missing cells as a regression.

The position mode is the identity, the factor of every style mode m is [1, I, S_m]: a
constant, a column of its own for every level, and R_m columns that levels share,

    T[d, l_1, .., l_M] = sum over sets e of style modes of  part_e[d, l_e]

and the part of a set (the empty set is the mean, {person} and {task} are the main effects,
{person, task} how this person does this task) is a core multiplied with the factors of its
modes. With cores Normal(0, variance[e, d]) integrated out the entries y of position d are

    y[d] ~ N(0, sum_e variance[e, d] K_e + noise[joint of d]^2 I)
    K_e[c, c'] = prod over m in e of (I + S_m diag(1 / precision_m) S_m^T)[l_m(c), l_m(c')]

    S_m[l, r]          ~ Normal(0, 1)
    precision_m[r]     ~ Gamma(1.5, 0.5)         a column that explains nothing goes
    log variance[e, d] ~ Normal(level[e], 1)     every position has its own balance
    level[e]           ~ Normal(-1, 2)           positions are scaled to unit spread first
    log noise[j]       ~ Normal(log 0.3, 1)

Without shared columns (R_m = 0) this is the additive person-plus-task mean with random
effects: each effect is shrunk by as much as its own position calls for, and least squares
(`additive`) is its limit for large variances and no interaction.
Levels that move alike (S_m) lend each other their interactions.

Entries that are missing take no part. What is predicted for them is Gaussian (`predict`).
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Array, Float, Int
from numpyro import distributions as dist

from ...errors import InputError
from ...gp.linalg import AnyArray, cholesky, inverse_factor


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
class CollapsedTucker:
    """The model with its settings; see the module for the equations.

    Parameters
    ----------
    ranks
        R_m, shared columns of every style mode's factor; 0 for none.
    joints
        Number of joints, each with a noise of its own.
    """

    ranks: tuple[int, ...]
    joints: int = 1
    name = "tucker_collapsed"

    def program(self, cells: Cells) -> None:
        """The generative program."""
        shape = cells.y.shape
        if len(shape) != len(self.ranks) + 1:
            raise InputError(
                "tucker",
                f"{len(self.ranks)} ranks for {len(shape) - 1} modes beside position",
                "Give a rank for every mode but position",
            )
        shared: dict[str, AnyArray] = {}
        for m, (length, rank) in enumerate(zip(shape[1:], self.ranks, strict=True), start=1):
            if rank:
                S = numpyro.sample(f"factor_{m}", _normal((length, rank)))
                log = numpyro.sample(f"log_precision_{m}", log_gamma(1.5, 0.5, rank))
                shared |= {f"factor_{m}": jnp.asarray(S), f"log_precision_{m}": jnp.asarray(log)}
        sets = len(mode_sets(len(self.ranks)))
        prior = dist.Normal(-1.0, 2.0).expand((sets,)).to_event()
        level = jnp.asarray(numpyro.sample("level", prior))
        gap = jnp.asarray(numpyro.sample("log_variance", _normal((sets, shape[0]))))
        noise = dist.Normal(np.log(0.3), 1.0).expand((self.joints,)).to_event()
        sd = jnp.exp(jnp.asarray(numpyro.sample("log_noise", noise)))[cells.joint]
        kernels = _level_kernels(shape[1:], shared)
        covariance = _covariances(kernels, jnp.exp(level[:, None] + gap))
        numpyro.factor("y", _log_marginal(cells, covariance, sd))

    def initial_values(self, cells: Cells, seed: int, count: int) -> dict[str, np.ndarray]:
        """Give random starting values.

        Returns
        -------
        Sites with a leading axis over `count` starts.
        """
        random = np.random.default_rng(seed)
        shape, sets = cells.y.shape, len(mode_sets(len(self.ranks)))
        first: dict[str, np.ndarray] = {
            "level": np.full((count, sets), -1.0),
            "log_variance": np.zeros((count, sets, shape[0])),
            "log_noise": np.full((count, self.joints), np.log(0.5)),
        }
        for m, (length, rank) in enumerate(zip(shape[1:], self.ranks, strict=True), start=1):
            if rank:
                first[f"factor_{m}"] = random.normal(size=(count, length, rank)) / np.sqrt(rank)
                first[f"log_precision_{m}"] = np.zeros((count, rank))
        return first

    def predict(
        self, cells: Cells, values: Mapping[str, AnyArray]
    ) -> tuple[Float[np.ndarray, "d ..."], Float[np.ndarray, "d ..."]]:
        """Give mean and standard deviation of T for all cells, without the noise.

        Parameters
        ----------
        cells
            The tensor with what is missing.
        values
            Values of the sites.
        """
        kernels = _level_kernels(cells.y.shape[1:], values)
        level, gap = jnp.asarray(values["level"]), jnp.asarray(values["log_variance"])
        variance = jnp.exp(level[:, None] + gap)
        sd = np.exp(np.asarray(values["log_noise"]))[cells.joint]
        mean, spread = _predicted(cells, _covariances(kernels, variance), jnp.asarray(sd))
        shape = cells.y.shape
        return np.asarray(mean).reshape(shape), np.asarray(spread).reshape(shape)


def mode_sets(modes: int) -> list[tuple[int, ...]]:
    """Give all sets of style modes, the empty one first: (), (0,), (1,), (0, 1) for two."""
    counts = range(modes + 1)
    return [chosen for count in counts for chosen in itertools.combinations(range(modes), count)]


def _level_kernels(lengths: tuple[int, ...], shared: Mapping[str, AnyArray]) -> list[Array]:
    """Give for every style mode how its levels' effects go together: I + S diag(..) S^T."""
    kernels = []
    for m, length in enumerate(lengths, start=1):
        kernel = jnp.eye(length)
        if f"factor_{m}" in shared:
            S = jnp.asarray(shared[f"factor_{m}"])
            kernel = kernel + (S * jnp.exp(-jnp.asarray(shared[f"log_precision_{m}"]))) @ S.T
        kernels.append(kernel)
    return kernels


def _covariances(kernels: list[Array], variance: AnyArray) -> Float[Array, "d c c"]:
    """Give the covariance of T over all cells for every position."""
    lengths = [len(K) for K in kernels]
    index = np.indices(lengths).reshape(len(kernels), -1)
    spread = [K[i][:, i] for K, i in zip(kernels, index, strict=True)]
    ones = jnp.ones_like(spread[0])
    parts = jnp.stack(
        [reduce(jnp.multiply, [spread[m] for m in chosen], ones) for chosen in
         mode_sets(len(kernels))]
    )  # fmt: skip
    return jnp.einsum("ed,eab->dab", variance, parts)


def _seen_factor(covariance: Array, seen: AnyArray, sd: AnyArray) -> Array:
    """Cholesky factor of the seen entries' covariance; unseen rows and columns are those of I."""
    both = seen[:, None] & seen[None]
    noise = jnp.where(seen, jnp.square(sd), 1.0)
    return cholesky(jnp.where(both, covariance, 0.0) + jnp.diag(noise))


def _log_marginal(cells: Cells, covariance: Array, sd: AnyArray) -> Array:
    """Log density of the seen entries; the others' part is the same for all values: 0."""
    flat = jnp.asarray(cells.y).reshape(len(cells.y), -1)
    seen = jnp.asarray(cells.seen).reshape(flat.shape)

    def of_position(y: Array, there: Array, K: Array, s: Array) -> Array:
        L = _seen_factor(K, there, s)
        white = jax.scipy.linalg.solve_triangular(L, jnp.where(there, y, 0.0), lower=True)
        half = jnp.log(jnp.diagonal(L)).sum()
        return -0.5 * white @ white - half - 0.5 * there.sum() * jnp.log(2.0 * jnp.pi)

    return jax.vmap(of_position)(flat, seen, covariance, jnp.asarray(sd)).sum()


@jax.jit
def _predicted(cells: Cells, covariance: Array, sd: Array) -> tuple[Array, Array]:
    """Mean and standard deviation of T given the seen entries."""
    flat = jnp.asarray(cells.y).reshape(len(cells.y), -1)
    seen = jnp.asarray(cells.seen).reshape(flat.shape)

    def of_position(y: Array, there: Array, K: Array, s: Array) -> tuple[Array, Array]:
        inverse = inverse_factor(_seen_factor(K, there, s))
        cross = inverse @ jnp.where(there[:, None], K, 0.0)
        mean = cross.T @ (inverse @ jnp.where(there, y, 0.0))
        left = jnp.diagonal(K) - jnp.square(cross).sum(axis=0)
        return mean, jnp.sqrt(jnp.maximum(left, 0.0))

    return jax.vmap(of_position)(flat, seen, covariance, sd)


def _normal(size: tuple[int, ...]) -> dist.Distribution:
    return dist.Normal(0.0, 1.0).expand(size).to_event()


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


def log_gamma(shape: float, rate: float, count: int) -> dist.Distribution:
    """Logarithm of a Gamma variable: its density has a mode on the whole line."""
    base = dist.Gamma(shape, rate).expand((count,))
    inverse = dist.transforms.ExpTransform().inv
    return dist.TransformedDistribution(base, inverse).to_event()
