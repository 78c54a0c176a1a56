"""Smoothing of series measured at even times, their hyperparameters averaged over.

Every column is a Matern process in time (`state_space`) seen with white noise of one sd. Length
scale, sd and smoothness are averaged over a grid, with a prior over the grid that the columns of
the recording teach (empirical Bayes, Kiefer and Wolfowitz 1956): columns of one body move alike.

Columns also move together. In an orthonormal basis V the noise is as white as it was, so V y_t
are smoothed column by column too, which is exact where y_t = V^T f_t + e_t with independent f.
Two bases are looked for in what the columns smoothed alone do, and count alike: eigenvectors of
the covariance of their velocities, and of what is faster than some hertz; correlations below a
threshold are taken for chance.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize_scalar
from scipy.signal import butter, filtfilt
from scipy.special import logsumexp

from .state_space import Columns, StateSpace, columns, log_densities, matern, smooth_mixture

# Steps of the prior over the grid, and the weight below which a point is left out for a column.
STEPS, LEAST = 50, 1e-3
# What of a grid is smoothed at once comes in so many points, that few programs are compiled.
BATCH = 16
# The noise is told by so many stretches of so many frames, evenly spread, beside each other.
MOST, STRETCH = 4, 300
# The sd of noise is looked for between these shares of the sd of the columns' second differences,
# first at so many of them.
NOISE_RANGE, TRIED = (1e-3, 2.0), 13


@dataclass(frozen=True)
class Settings:
    """Settings of smoothing; the defaults were chosen on training recordings.

    orders
        Smoothness less 1/2 of the processes of the grid.
    lengths_s
        Their length scales in seconds.
    ratios
        Their sds in those of the noise.
    velocity_threshold
        Below it correlations of velocities are taken for chance; no such basis where None.
    fast_threshold
        That of what is faster than `fast_hz`; no such basis where None.
    fast_hz
        What is faster makes the second basis.
    stretch_s
        Seconds after which all of this is learned anew.
    """

    orders: tuple[int, ...] = (1, 2)
    lengths_s: tuple[float, ...] = tuple(np.geomspace(0.033, 1.33, 8).tolist())
    ratios: tuple[float, ...] = tuple(np.geomspace(0.1, 1e4, 14).tolist())
    velocity_threshold: float | None = 0.5
    fast_threshold: float | None = 0.3
    fast_hz: float = 4.0
    stretch_s: float = 1.5


SETTINGS = Settings()


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


def grid(rate: float, settings: Settings = SETTINGS) -> StateSpace:
    """Return the processes of the grid at a frame rate (Hz); sds are in those of the noise."""
    size = max(settings.orders) + 1
    each = [
        matern(order, length * rate, ratio, size)
        for order in settings.orders
        for length in settings.lengths_s
        for ratio in settings.ratios
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
    total = np.asarray(logsumexp(joint, axis=0))
    return np.exp(joint - total), float(total.sum())


def noise_sd(
    y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"], rate: float,
    settings: Settings = SETTINGS,
) -> float:  # fmt: skip
    """Return the sd of the noise, shared by the columns, under which they are likeliest.

    Parameters
    ----------
    y, seen
        Columns that move, and what is seen of them.
    rate
        Frames a second.
    settings
        Of the grid.
    """
    y, seen = _stretches(y, seen)
    processes, centred = grid(rate, settings), _centred(y, seen)
    differences = np.diff(centred, 2, axis=0)[(seen[2:] & seen[1:-1] & seen[:-2])]
    usual = float(np.sqrt(np.median(differences**2) / 0.4549 / 6.0)) if differences.size else 0.0
    usual = max(usual, 1e-9 * float(np.std(centred)) + 1e-300)
    count = seen.sum(axis=0)

    def against(log_sd: float) -> float:
        sd = np.exp(log_sd)
        each = np.asarray(log_densities(processes, columns(centred / sd, seen)))
        return -(learned_weights(each)[1] - float(count.sum()) * log_sd)

    # A grid of processes makes the likelihood wavy: the best of some sds is where to look closely.
    low, high = (np.log(share * usual) for share in NOISE_RANGE)
    tried = np.linspace(low, high, TRIED)
    near = int(np.argmin([against(log_sd) for log_sd in tried]))
    bounds = tried[max(near - 1, 0)], tried[min(near + 1, TRIED - 1)]
    found = minimize_scalar(against, bounds=bounds, method="bounded", options={"xatol": 0.01})
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
    mean: Float[np.ndarray, "n c"], rate: float, settings: Settings = SETTINGS
) -> tuple[Float[np.ndarray, "c c"], ...]:
    """Return the orthonormal bases V in which columns move by themselves.

    Parameters
    ----------
    mean
        Columns without their noise, at least three frames.
    rate
        Frames a second.
    settings
        Of the bases; none where both thresholds are None, or all is slower than can be told.
    """
    found, fast = [], settings.fast_hz
    if settings.velocity_threshold is not None:
        found.append(basis_of(np.diff(mean, axis=0), settings.velocity_threshold))
    if settings.fast_threshold is not None and rate > 4.0 * fast and len(mean) > 9:
        low = lowpass(mean, fast, rate)
        found.append(basis_of(mean - low, settings.fast_threshold))
    return tuple(found)


def lowpass(y: Float[np.ndarray, "n c"], cutoff: float, rate: float) -> Float[np.ndarray, "n c"]:
    """Return columns filtered without delay: the Butterworth filter of gait laboratories.

    Of order 2, forwards and backwards, which together are of order 4.

    Parameters
    ----------
    y
        Columns of more than nine frames.
    cutoff, rate
        Cut-off frequency of one direction, and frames a second, in Hz.
    """
    b, a = butter(2, 2.0 * cutoff / rate)[:2]  # pyright: ignore[reportIndexIssue, reportOptionalSubscript]
    return filtfilt(b, a, y, axis=0)


def basis_of(x: Float[np.ndarray, "m c"], threshold: float) -> Float[np.ndarray, "c c"]:
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


def _stretches(
    y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"]
) -> tuple[Float[np.ndarray, "m d"], Bool[np.ndarray, "m d"]]:
    """Return long columns as stretches of them beside each other, evenly spread."""
    if len(y) <= STRETCH:
        return y, seen
    count = min(MOST, len(y) // STRETCH)
    starts = np.linspace(0, len(y) - STRETCH, count).round().astype(int).tolist()
    y, seen = (np.concatenate([a[i : i + STRETCH] for i in starts], axis=1) for a in (y, seen))
    some = seen.any(axis=0)
    return y[:, some], seen[:, some]


def _offset(y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"]) -> np.ndarray:
    return np.where(seen, y, 0.0).sum(axis=0) / seen.sum(axis=0)


def _centred(y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"]) -> np.ndarray:
    return np.where(seen, y - _offset(y, seen), 0.0)
