"""Series without their noise, gaps filled in from the columns that are seen.

Columns that are all seen are smoothed in bases in which they move by themselves (`series`). Gaps
are filled in first, in the eigenvectors of the covariance of the columns' velocities: a column
that moved with others goes on to move with them. The processes of this basis are filtered together
in windows about the gaps (`coupled_filter`), each with the process of the grid that is likeliest
for it. The gaps' means then stand for them while the rest is smoothed, and in the gaps mean and sd
are those of the windows.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import maximum_filter1d

from .coupled_filter import smooth_coupled
from .series import (
    SETTINGS,
    Settings,
    bases,
    basis_of,
    grid,
    learned_weights,
    noise_sd,
    smooth_columns,
)
from .state_space import StateSpace, columns, log_densities

# So long stretches of a recording fade into each other.
FADE_S = 0.5
# A window reaches so many seconds beyond a gap, and so many frames are filtered at once.
MARGIN_S, WINDOW = 1.0, 960
ROUND = 64
# Frames with nothing missing, in numbers of columns, that are enough to learn from alone.
ENOUGH = 2
# Stretches that are hidden to see how far off gaps are.
HIDDEN = 3


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
    >>> white = np.random.default_rng(0).normal(size=(60, 1))
    >>> y = np.sin(np.arange(60.0) / 10)[:, None] + 0.1 * white
    >>> smooth_series(y, 60.0).mean.shape[1:]
    (60, 1)
    """
    seen = np.isfinite(y)
    known = noise_sd(np.where(seen, y, 0.0), seen, rate, settings) if noise is None else noise
    processes = grid(rate, settings)
    filled, gap_sd = y, np.zeros(y.shape)
    if not seen.all():
        filled, gap_sd = _filled(np.where(seen, y, 0.0), seen, known, processes, rate)
    mean, sd = _in_stretches(filled, known, processes, rate, settings)
    return Series(np.where(seen, mean, filled), np.where(seen, sd, gap_sd), known)


def _in_stretches(
    y: Float[np.ndarray, "n c"], noise: float, processes: StateSpace, rate: float,
    settings: Settings,
) -> tuple[Float[np.ndarray, "s n c"], Float[np.ndarray, "s n c"]]:  # fmt: skip
    """Return mean and sd of complete columns, of stretches that fade into each other."""
    n, fade = len(y), round(FADE_S * rate)
    step = max(1, round(settings.stretch_s * rate))
    # Of one length, that few programs are compiled.
    length = min(n, step + 2 * fade)
    count = max(1, -(-(n - 2 * fade) // step))
    starts = np.linspace(0, n - length, count).round().astype(int).tolist()
    rise = np.minimum(np.arange(length) + 1.0, max(fade, 1))
    weight = np.minimum(rise, rise[::-1])[:, None]
    told = [_in_bases(y[i : i + length], noise, processes, rate, settings) for i in starts]
    shape = (len(told[0][0]), n, y.shape[1])
    mean, variance, total = np.zeros(shape), np.zeros(shape), np.zeros((n, 1))
    for start, (one_mean, one_sd) in zip(starts, told, strict=True):
        inside = slice(start, start + length)
        mean[:, inside] += weight * one_mean
        variance[:, inside] += weight * one_sd**2
        total[inside] += weight
    return mean / total, np.sqrt(variance / total)


def _in_bases(
    y: Float[np.ndarray, "n c"], noise: float, processes: StateSpace, rate: float,
    settings: Settings,
) -> tuple[Float[np.ndarray, "s n c"], Float[np.ndarray, "s n c"]]:  # fmt: skip
    """Return mean and sd of complete columns, as every basis has them."""
    alone = smooth_columns(y, np.ones(y.shape, bool), noise, processes)
    several = bases(alone.mean, rate, settings) if y.shape[1] > 1 else ()
    found = [(alone.mean, alone.sd)] if not several else [
        _rotated(y, basis, noise, processes) for basis in several
    ]  # fmt: skip
    mean, sd = (np.stack(part) for part in zip(*found, strict=True))
    return mean, sd


def _filled(
    y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"], noise: float,
    processes: StateSpace, rate: float,
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "n c"]]:  # fmt: skip
    """Return values with means in the gaps, and the sds there.

    The basis is learned, and taken for known: how much further off that leads is told by stretches
    where the same columns are hidden, and the basis is learned without them.
    """
    found = smooth_columns(y, seen, noise, processes)
    y, alone = np.where(seen, y, found.mean), found.mean
    if y.shape[1] == 1:
        return y, np.where(seen, 0.0, found.sd)
    mean, sd = _fill(y, seen, ~seen.all(axis=1), alone, noise, processes, rate)
    lost, squares = ~seen.all(axis=0), []
    for stretch in _stretches_like_gaps(seen):
        hidden = seen.copy()
        hidden[stretch, lost] = False
        rows = np.zeros(len(y), bool)
        rows[stretch] = True
        told, told_sd = _fill(y, hidden, rows, alone, noise, processes, rate)
        # What was measured has noise that the gaps' values have not.
        off = np.mean((told - y)[stretch, lost] ** 2, axis=0) - noise**2
        squares.append(off / np.mean(told_sd[stretch, lost] ** 2, axis=0))
    wider = np.sqrt(max(1.0, float(np.mean(squares)))) if squares else 1.0
    return mean, wider * sd


def _fill(
    y: Float[np.ndarray, "n c"], seen: Bool[np.ndarray, "n c"], rows: Bool[np.ndarray, " n"],
    alone: Float[np.ndarray, "n c"], noise: float, processes: StateSpace, rate: float,
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "n c"]]:  # fmt: skip
    """Return values with means in the gaps of some rows, and sds there: zero elsewhere."""
    whole = seen.all(axis=1)
    if whole.sum() < min(ENOUGH * y.shape[1], len(y)):
        whole = np.ones(len(y), bool)
    basis = basis_of(np.diff(alone, axis=0)[whole[1:] & whole[:-1]], 0.0)
    offset = y[whole].mean(axis=0)
    turned = (y - offset) @ basis.T / noise
    of_whole = columns(turned, np.broadcast_to(whole[:, None], turned.shape))
    weights, _ = learned_weights(np.asarray(log_densities(processes, of_whole)))
    best = StateSpace(*(jnp.asarray(part)[weights.argmax(axis=0)] for part in processes))
    filled, sd = y.copy(), np.zeros(y.shape)
    for window, core in _windows(rows, round(MARGIN_S * rate)):
        n = window.stop - window.start
        fill = ((0, -n % ROUND), (0, 0))
        value = np.pad((y[window] - offset) / noise, fill)
        mean, variance = smooth_coupled(best, basis, value, np.pad(1.0 * seen[window], fill))
        inside = slice(core.start - window.start, core.stop - window.start)
        gaps = ~seen[core]
        filled[core] = np.where(gaps, offset + noise * np.asarray(mean)[inside], filled[core])
        sd[core] = np.where(gaps, noise * np.sqrt(np.asarray(variance)[inside]), sd[core])
    return filled, sd


def _rotated(
    y: Float[np.ndarray, "n c"], basis: Float[np.ndarray, "c c"], noise: float,
    processes: StateSpace,
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, "n c"]]:  # fmt: skip
    """Return mean and sd of columns all of which is seen, or filled in."""
    found = smooth_columns(y @ basis.T, np.ones(y.shape, bool), noise, processes)
    return found.mean @ basis, np.sqrt(found.sd**2 @ basis**2)


def _stretches_like_gaps(seen: Bool[np.ndarray, "n c"]) -> Iterator[slice]:
    """Return stretches where all is seen, as long as the longest gap, evenly spread."""
    whole = seen.all(axis=1)
    edges = np.flatnonzero(np.diff((~whole).astype(int), prepend=0, append=0)).reshape(-1, 2)
    length = int((edges[:, 1] - edges[:, 0]).max())
    run = np.convolve(whole, np.ones(length), mode="valid") if length <= len(whole) else np.zeros(0)
    starts = np.flatnonzero(run > length - 0.5)
    # Those at the ends of the recording have nothing on one side.
    starts = starts[(starts > 0) & (starts + length < len(whole))]
    taken = np.linspace(0, len(starts) - 1, HIDDEN + 2).round().astype(int)[1:-1]
    for start in dict.fromkeys(starts[taken].tolist() if len(starts) else []):
        yield slice(start, start + length)


def _windows(gaps: Bool[np.ndarray, " n"], margin: int) -> Iterator[tuple[slice, slice]]:
    """Return windows that reach beyond gaps, and the part of each that it is for."""
    near = maximum_filter1d(gaps.astype(int), 2 * margin + 1, mode="constant")
    edges = np.flatnonzero(np.diff(near, prepend=0, append=0))
    for first, last in edges.reshape(-1, 2).tolist():
        for start in range(first, last, WINDOW):
            stop = min(start + WINDOW, last)
            window = slice(max(start - margin, first), min(stop + margin, last))
            yield window, slice(start, stop)
