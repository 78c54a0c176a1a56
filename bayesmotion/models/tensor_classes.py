"""What a fitted multifactor tensor says of a new segment, for every combination of levels.

A new segment of known levels is Student t (`classes`). Of a level never seen (an alien
person or task) the effect is Gaussian about the mean of the known ones, with a covariance
estimated from them: (sum_l d_l d_l^T + 2 E[Sigma]) / (L - 1 + 2), d_l = effect - mean; the
second term says that the prior is worth two levels whose effects are as large as Sigma.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import gammaln

from .multifactor_tensor import TensorData, main_effects

NEW = "(new)"
PRIOR_LEVELS = 2.0


class Classes(NamedTuple):
    """Student t densities of a segment of each combination of levels.

    mean
        (C, Q).
    factor
        (C, Q, Q): W with |W^T (y - mean)|^2 the squared distance in units of the scale.
    log_det
        (C,) of W.
    dof
        Degrees of freedom, the same for all.
    level
        (C, M) index of the level of every mode; the number of known levels for a new one.
    """

    mean: Float[np.ndarray, "c q"]
    factor: Float[np.ndarray, "c q q"]
    log_det: Float[np.ndarray, " c"]
    dof: float
    level: Int[np.ndarray, "c m"]


def classes(
    data: TensorData,
    level: Int[np.ndarray, "n m"],
    counts: Sequence[int],
    *,
    log_odds: float,
    log_scale: float,
    log_dof: float,
) -> Classes:
    """Give the density of a new segment for every combination of levels, new ones included.

    Parameters
    ----------
    data
        What the program was fitted to.
    level, counts
        As for `tensor_data`.
    log_odds, log_scale, log_dof
        Values of the sites.
    """
    y, design, same = (np.asarray(array) for array in data)
    share = 1.0 / (1.0 + np.exp(-log_odds))
    grid = np.array(list(itertools.product(*(range(count + 1) for count in counts))))
    K = share * same + (1.0 - share) * np.eye(len(y))
    solved = np.linalg.solve(K, np.concatenate([y, design], axis=1))
    Ky, Ka = solved[:, : y.shape[1]], solved[:, y.shape[1] :]
    spread = np.linalg.inv(design.T @ Ka)
    effects = spread @ (design.T @ Ky)
    residual = y - design @ effects
    matrix = np.exp(log_scale) * np.eye(y.shape[1]) + residual.T @ (Ky - Ka @ effects)
    dof = float(np.exp(log_dof)) + len(y) - design.shape[1]
    cross = share * (grid[:, None] == level[None]).all(axis=2)
    rows = main_effects(grid, counts)
    weights = np.linalg.solve(K, cross.T).T
    mean = rows @ effects + weights @ residual
    gap = rows - weights @ design
    variance = 1.0 - np.sum(weights * cross, axis=1)
    variance += np.einsum("cr,rs,cs->c", gap, spread, gap)
    covariance = variance[:, None, None] * matrix / dof
    for mode, extra in enumerate(_new_level(effects, counts, matrix / max(dof - 2.0, 1.0))):
        covariance[grid[:, mode] == counts[mode]] += extra
    factor = np.linalg.inv(np.linalg.cholesky(covariance)).swapaxes(-1, -2)
    log_det = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    return Classes(mean, factor, log_det, dof, grid)


def log_density(classes: Classes, y: Float[np.ndarray, "n q"]) -> Float[np.ndarray, "n c"]:
    """Log density of segments under every combination of levels.

    The Student t density of `classes`, up to nothing: it is normalised.
    """
    q, dof = y.shape[1], classes.dof
    gap = y[:, None] - classes.mean[None]
    distance = np.square(np.einsum("ncq,cqr->ncr", gap, classes.factor, optimize=True)).sum(2)
    constant = gammaln(0.5 * (dof + q)) - gammaln(0.5 * dof) - 0.5 * q * np.log(dof * np.pi)
    return constant + classes.log_det - 0.5 * (dof + q) * np.log1p(distance / dof)


def _new_level(effects: np.ndarray, counts: Sequence[int], sigma: np.ndarray) -> list[np.ndarray]:
    """Give for every mode the covariance of the effect of a level never seen."""
    found, first = [], 1
    for count in counts:
        free = effects[first : first + count - 1]
        first += count - 1
        all_levels = np.concatenate([free, -free.sum(axis=0, keepdims=True)])
        scatter = all_levels.T @ all_levels + PRIOR_LEVELS * sigma
        found.append(scatter / (count - 1 + PRIOR_LEVELS))
    return found
