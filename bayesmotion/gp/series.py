"""Smoothing of series measured at even times, their hyperparameters averaged over.

Every column is a Matern process in time (`state_space`) seen with white noise of one sd. Length
scale, sd and smoothness are averaged over a grid, with a prior over the grid that the columns of
the recording teach (empirical Bayes, Kiefer and Wolfowitz 1956): columns of one body move alike.

Columns also move together. In an orthonormal basis V the noise is as white as it was, so V y_t
are smoothed column by column too, which is exact where y_t = V^T f_t + e_t with independent f.
Two bases are looked for in what the columns smoothed alone do, and count alike: eigenvectors of
the covariance of their velocities, and of what is faster than `FAST_HZ`; correlations below a
threshold (chosen, as the grid was, on training recordings) are taken for chance.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize_scalar
from scipy.signal import butter, filtfilt
from scipy.special import logsumexp

from .state_space import Columns, StateSpace, columns, log_densities, matern, smooth_mixture

# Settings, chosen on training recordings.
ORDERS = (1, 2)
LENGTHS_S = tuple(np.geomspace(0.033, 1.33, 8).tolist())
RATIOS = tuple(np.geomspace(0.1, 1e4, 14).tolist())
VELOCITY_THRESHOLD, FAST_THRESHOLD, FAST_HZ = 0.5, 0.3, 4.0
# Steps of the prior over the grid, and the weight below which a point is left out for a column.
STEPS, LEAST = 50, 1e-3
# What of a grid is smoothed at once comes in so many points, that few programs are compiled.
BATCH = 16
# The sd of noise is looked for between these shares of the sd of the columns' second differences.
NOISE_RANGE = (1e-3, 2.0)


@dataclass(frozen=True)
class Smoothed:
    """Series without their noise.

    mean, sd
        (N, C) of the noise-free values.
    weights
        (G, C) of the points of the grid.
    """

    mean: Float[np.ndarray, "n c"]
    sd: Float[np.ndarray, "n c"]
    weights: Float[np.ndarray, "g c"]


def grid(rate: float) -> StateSpace:
    """Return the processes of the grid at a frame rate (Hz); sds are in those of the noise."""
    size = max(ORDERS) + 1
    each = [
        matern(order, length * rate, ratio, size)
        for order in ORDERS
        for length in LENGTHS_S
        for ratio in RATIOS
    ]
    return StateSpace(*(np.stack(part) for part in zip(*each, strict=True)))


def learned_weights(
    log_density: Float[np.ndarray, "g c"],
) -> tuple[Float[np.ndarray, "g c"], float]:
    """Return the weights of the grid for every column, and the log density of all of them.

    The prior over the grid is the one under which the columns are likeliest, from an even one.
    """
    prior = np.full(len(log_density), -np.log(len(log_density)))
    for _ in range(STEPS):
        joint = log_density + prior[:, None]
        weights = np.exp(joint - logsumexp(joint, axis=0))
        prior = np.log(weights.mean(axis=1) + 1e-12)
    joint = log_density + prior[:, None]
    total = logsumexp(joint, axis=0)
    return np.exp(joint - total), float(total.sum())


def noise_sd(
    y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"], rate: float
) -> float:
    """Return the sd of the noise, shared by the columns, under which they are likeliest.

    Parameters
    ----------
    y, seen
        Columns that move, and what is seen of them.
    rate
        Frames a second.
    """
    processes, centred = grid(rate), _centred(y, seen)
    differences = np.diff(centred, 2, axis=0)[(seen[2:] & seen[1:-1] & seen[:-2])]
    usual = float(np.sqrt(np.median(differences**2) / 0.4549 / 6.0)) if differences.size else 0.0
    usual = max(usual, 1e-9 * float(np.std(centred)) + 1e-300)
    count = seen.sum(axis=0)

    def against(log_sd: float) -> float:
        sd = np.exp(log_sd)
        each = np.asarray(log_densities(processes, columns(centred / sd, seen)))
        return -(learned_weights(each)[1] - float(count.sum()) * log_sd)

    low, high = (np.log(share * usual) for share in NOISE_RANGE)
    found = minimize_scalar(against, bounds=(low, high), method="bounded", options={"xatol": 0.01})
    return float(np.exp(found.x))


def smooth_columns(
    y: Float[np.ndarray, "n c"],
    seen: Bool[np.ndarray, "n c"],
    noise: float,
    processes: StateSpace,
) -> Smoothed:
    """Return columns without their noise, each on its own; what is missing is filled in.

    Parameters
    ----------
    y, seen
        Columns, and what is seen of them: something of each.
    noise
        The sd of the noise.
    processes
        The grid, sds in those of the noise.
    """
    offset = _offset(y, seen)
    data = columns((y - offset) / noise, seen)
    weights, _ = learned_weights(np.asarray(log_densities(processes, data)))
    mean, variance = _mixed(processes, weights, data)
    variance = variance + 1.0 / seen.sum(axis=0)  # that of the offset, at the least
    return Smoothed(offset + noise * mean, noise * np.sqrt(variance), weights)


def bases(
    mean: Float[np.ndarray, "n c"], rate: float
) -> tuple[Float[np.ndarray, "c c"], ...]:
    """Return the orthonormal bases V in which columns move by themselves.

    Parameters
    ----------
    mean
        Columns without their noise, at least three frames.
    rate
        Frames a second.
    """
    found = [_basis(np.diff(mean, axis=0), VELOCITY_THRESHOLD)]
    if rate > 4.0 * FAST_HZ and len(mean) > 9:
        low = filtfilt(*butter(2, 2.0 * FAST_HZ / rate), mean, axis=0)  # pyright: ignore
        found.append(_basis(mean - low, FAST_THRESHOLD))
    return tuple(found)


def _basis(x: Float[np.ndarray, "m c"], threshold: float) -> Float[np.ndarray, "c c"]:
    """Return the eigenvectors of the covariance with soft-thresholded correlations."""
    cov = np.atleast_2d(np.cov(x, rowvar=False))
    sd = np.sqrt(np.maximum(np.diag(cov), 1e-12 * np.trace(cov) + 1e-300))
    correlation = cov / np.outer(sd, sd)
    kept = np.sign(correlation) * np.maximum(np.abs(correlation) - threshold, 0.0)
    kept /= 1.0 - threshold
    np.fill_diagonal(kept, 1.0)
    return np.linalg.eigh(kept * np.outer(sd, sd))[1].T[::-1]


def _mixed(
    processes: StateSpace, weights: Float[np.ndarray, "g c"], data: Columns
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "n c"]]:
    """Return mean and variance over the points of the grid that some column is of."""
    kept = np.flatnonzero((weights > LEAST).any(axis=1))
    share = weights[kept] / weights[kept].sum(axis=0)
    fill = -len(kept) % BATCH
    kept = np.concatenate([kept, np.repeat(kept[:1], fill)])
    share = np.pad(share, ((0, fill), (0, 0)))
    some = StateSpace(*(jnp.asarray(part)[kept] for part in processes))
    mean, variance = smooth_mixture(some, share, data)
    return np.asarray(mean), np.asarray(variance)


def _offset(y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"]) -> np.ndarray:
    return np.where(seen, y, 0.0).sum(axis=0) / seen.sum(axis=0)


def _centred(y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"]) -> np.ndarray:
    return np.where(seen, y - _offset(y, seen), 0.0)
