"""Series without their noise, gaps filled in from the columns that are seen.

Columns that are all seen are smoothed in bases in which they move by themselves (`series`). Where
some are missing, the processes of a basis are filtered together in windows about the gaps
(`coupled_filter`), each with the process of the grid that is likeliest for it: a column that
moved with others goes on to move with them. The gaps' means then stand for them while the rest is
smoothed, and in the gaps mean and sd are those of the windows.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from .coupled_filter import smooth_coupled
from .series import SETTINGS, Settings, bases, grid, learned_weights, noise_sd, smooth_columns
from .state_space import StateSpace, columns, log_densities

# A window reaches so many seconds beyond a gap, and so many frames are filtered at once.
MARGIN_S, WINDOW = 1.0, 960
ROUND = 64
# Frames with nothing missing, in numbers of columns, that are enough to learn from alone.
ENOUGH = 2


@dataclass(frozen=True)
class Series:
    """Series without their noise, as every basis has them; they count alike.

    mean, sd
        (S, N, C) of the noise-free values.
    noise_sd
        The sd of the noise.
    """

    mean: Float[np.ndarray, "s n c"]
    sd: Float[np.ndarray, "s n c"]
    noise_sd: float


def smooth_series(
    y: Float[np.ndarray, "n c"], rate: float, noise: float | None = None,
    settings: Settings = SETTINGS,
) -> Series:  # fmt: skip
    """Return series without their noise, and with their gaps filled in.

    Parameters
    ----------
    y
        Columns with noise of one sd, NaN where missing; something is seen of each, and each moves.
    rate
        Frames a second.
    noise
        The sd of the noise; estimated where None.
    settings
        Of the grid and the bases.

    Examples
    --------
    >>> import numpy as np
    >>> from bayesmotion.gp.gaps import smooth_series
    >>> y = np.sin(np.arange(60.0) / 10)[:, None] + 0.1 * np.random.default_rng(0).normal(size=(60, 1))
    >>> smooth_series(y, 60.0).mean.shape[1:]
    (60, 1)
    """
    seen = np.isfinite(y)
    known = noise_sd(np.where(seen, y, 0.0), seen, rate, settings) if noise is None else noise
    processes = grid(rate, settings)
    alone = smooth_columns(np.where(seen, y, 0.0), seen, known, processes)
    several = bases(alone.mean, rate, settings) if y.shape[1] > 1 else ()
    if not several:
        return Series(alone.mean[None], alone.sd[None], known)
    whole = seen.all(axis=1)
    if whole.sum() < min(ENOUGH * y.shape[1], len(y)):
        whole = np.ones(len(y), bool)
    learned_from = np.where(seen, y, alone.mean)
    found = [
        _in_basis(learned_from, seen, whole, basis, known, processes, rate) for basis in several
    ]
    mean, sd = (np.stack(part) for part in zip(*found, strict=True))
    return Series(mean, sd, known)


def _in_basis(
    y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"], whole: Bool[np.ndarray, " n"],
    basis: Float[np.ndarray, "c c"], noise: float, processes: StateSpace, rate: float,
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "n c"]]:  # fmt: skip
    """Return mean and sd; `y` has first guesses in the gaps."""
    if seen.all():
        return _rotated(y, basis, noise, processes)
    offset = y[whole].mean(axis=0)
    turned = (y - offset) @ basis.T / noise
    of_whole = columns(turned, np.broadcast_to(whole[:, None], turned.shape))
    weights, _ = learned_weights(np.asarray(log_densities(processes, of_whole)))
    best = StateSpace(*(jnp.asarray(part)[weights.argmax(axis=0)] for part in processes))
    filled, gap_sd = y.copy(), np.zeros(y.shape)
    for window, core in _windows(~seen.all(axis=1), round(MARGIN_S * rate)):
        n = window.stop - window.start
        fill = ((0, -n % ROUND), (0, 0))
        value = np.pad((y[window] - offset) / noise, fill)
        known = np.pad(seen[window].astype(float), fill)
        mean, variance = smooth_coupled(best, basis, value, known)
        inside = slice(core.start - window.start, core.stop - window.start)
        gaps = ~seen[core]
        filled[core] = np.where(gaps, offset + noise * np.asarray(mean)[inside], filled[core])
        gap_sd[core] = np.where(gaps, noise * np.sqrt(np.asarray(variance)[inside]), gap_sd[core])
    mean, sd = _rotated(filled, basis, noise, processes)
    return np.where(seen, mean, filled), np.where(seen, sd, gap_sd)


def _rotated(
    y: Float[np.ndarray, "n c"], basis: Float[np.ndarray, "c c"], noise: float,
    processes: StateSpace,
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "n c"]]:  # fmt: skip
    found = smooth_columns(y @ basis.T, np.ones(y.shape, bool), noise, processes)
    return found.mean @ basis, np.sqrt(found.sd**2 @ basis**2)


def _windows(gaps: Bool[np.ndarray, " n"], margin: int) -> Iterator[tuple[slice, slice]]:
    """Return windows about gaps, and the part of each that it is for."""
    n = len(gaps)
    near = np.convolve(gaps, np.ones(2 * margin + 1), mode="same") > 0.5 if margin else gaps
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
    for first, last in edges.reshape(-1, 2).tolist():
        for start in range(first, last, WINDOW):
            stop = min(start + WINDOW, last)
            yield slice(max(start - margin, 0), min(stop + margin, n)), slice(start, stop)
