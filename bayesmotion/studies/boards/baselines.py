"""Simple forecasts that a model has to beat on a board, each told by the training clips alone.

    hold       the last pose
    zero       the training mean
    nearest    the stretch of a training clip that is most like the context
    cycle      the mean cycle of the training clips, phase and period unknown
    mixed      their cycles mixed, phase and period unknown

Cycles are Fourier series of the training clips, brought into one phase. With coefficients
w = mean + sum_c a_c (w_c - mean), a_c ~ N(0, 1 / (C - 1)) for `mixed` and none for `cycle`,

    y_n = w^T f(theta + 2 pi n / T) + r_n,    log T ~ N(mean, sd^2) of the training periods

r is a vector Ornstein-Uhlenbeck process of the covariance and time scale that training clips
have about their mean cycle (or about their own, for `mixed`). Phase and period lie on a grid, whose
cells count by the density of the context; the forecast is the mixture over the cells.

The first three say nothing of how sure they are: their sd is that of their errors on training
clips that are left out in turn, column by column and frame by frame.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...prediction import Mixture
from .harness import Clips, Method, thinned

Point = Callable[[Clips, Float[np.ndarray, "k d"], int], Float[np.ndarray, "h d"]]
HARMONICS, PHASES = 8, 72
# Periods on the grid: at least so many, and none farther from the next than this share of it.
PERIODS, APART = 15, 0.02
MOST_CELLS = 192
NEARLY = 1.5
LEAST_SD = 1e-3
SMOOTH = 9  # frames on either side that the sd of a simple forecast is averaged over


def hold(train: Clips, context: np.ndarray, horizon: int) -> np.ndarray:
    """Return the last pose, again and again."""
    return np.repeat(context[-1:], horizon, axis=0)


def zero(train: Clips, context: np.ndarray, horizon: int) -> np.ndarray:
    """Return the mean pose of the training clips."""
    mean = np.concatenate([*train.values()]).mean(axis=0)
    return np.repeat(mean[None], horizon, axis=0)


def nearest(train: Clips, context: np.ndarray, horizon: int) -> np.ndarray:
    """Return what followed the training stretch most like the context; its end is held."""
    k, best, found = len(context), np.inf, hold(train, context, horizon)
    for clip in train.values():
        last = max(len(clip) - k - horizon, len(clip) // 2 - k)
        for first in range(last + 1):
            distance = float(np.mean((clip[first : first + k] - context) ** 2))
            if distance < best:
                best, after = distance, clip[first + k : first + k + horizon]
                rest = np.repeat(after[-1:], horizon - len(after), axis=0)
                found = np.concatenate([after, rest])
    return found


def with_sd(point: Point, train: Clips, horizon: int, context: int) -> Method:
    """Return a simple forecast with the sd of its errors on training clips left out in turn.

    Parameters
    ----------
    point
        The forecast: a function of training clips, context and horizon.
    train
        The training clips.
    horizon, context
        Of the clips to forecast.
    """
    errors = []
    for left, clip in train.items():
        rest = {name: one for name, one in train.items() if name != left}
        ahead = min(horizon, len(clip) - context)
        told = point(rest, clip[:context], ahead)
        error = clip[context : context + ahead] - told
        errors.append(np.pad(error**2, ((0, horizon - ahead), (0, 0)), mode="edge"))
    mean = np.mean(errors, axis=0)
    padded = np.pad(mean, ((SMOOTH, SMOOTH), (0, 0)), mode="edge")
    window = np.ones(2 * SMOOTH + 1) / (2 * SMOOTH + 1)
    smooth = np.stack([np.convolve(column, window, mode="valid") for column in padded.T], axis=1)
    sd = np.sqrt(smooth + LEAST_SD**2)

    def method(given: np.ndarray, ahead: int) -> Mixture:
        return Mixture(point(train, given, ahead)[None], sd[None, :ahead], np.ones(1))

    return method


class Cycles(NamedTuple):
    """Fourier series of training clips in one phase.

    weights
        (C, 2 J + 1, D).
    phase, period
        (C,) phase at the first frame, and frames a cycle.
    """

    weights: Float[np.ndarray, "c j d"]
    phase: Float[np.ndarray, " c"]
    period: Float[np.ndarray, " c"]


def waves(theta: Float[np.ndarray, " n"], harmonics: int = HARMONICS) -> Float[np.ndarray, "n j"]:
    """Return 1, cos k theta and sin k theta, k up to so many harmonics."""
    angles = theta[:, None] * np.arange(1, harmonics + 1)
    return np.concatenate([np.ones((len(theta), 1)), np.cos(angles), np.sin(angles)], axis=1)


def cycles_of(train: Clips, frame_rate: float, harmonics: int = HARMONICS) -> Cycles:
    """Fit a Fourier series to every training clip, its period by a search over 0.5 to 2 s."""
    periods, series = [], []
    grid = frame_rate * np.exp(np.linspace(np.log(0.5), np.log(2.0), 400))
    for clip in train.values():
        period = _period(clip, grid[grid <= max(len(clip), grid[0])], harmonics)
        periods.append(period)
        series.append(_series(clip, 2.0 * np.pi * np.arange(len(clip)) / period, harmonics)[0])
    first = np.stack([w[1] - 1j * w[1 + harmonics] for w in series])
    common = np.linalg.svd(first, full_matrices=False)[0][:, 0]
    phase = np.angle(common) - np.angle(common[0])
    weights = [
        _series(clip, 2.0 * np.pi * np.arange(len(clip)) / period + shift, harmonics)[0]
        for clip, period, shift in zip(train.values(), periods, phase, strict=True)
    ]
    return Cycles(np.stack(weights), phase, np.array(periods))


def _series(clip: np.ndarray, theta: np.ndarray, harmonics: int) -> tuple[np.ndarray, float]:
    """Return least squares coefficients and the mean squared error; short clips are held down."""
    F = waves(theta, harmonics)
    gram = F.T @ F + 1e-3 * np.eye(F.shape[1])
    weights = np.linalg.solve(gram, F.T @ clip)
    return weights, float(np.mean((clip - F @ weights) ** 2))


def _period(clip: np.ndarray, periods: np.ndarray, harmonics: int) -> float:
    """Return the shortest period that fits nearly as well as the best: twice a period fits too."""
    time = 2.0 * np.pi * np.arange(len(clip))
    errors = np.array([_series(clip, time / T, harmonics)[1] for T in periods])
    near = periods[np.argmax(errors <= NEARLY * errors.min())]
    fine = near * np.exp(np.linspace(-0.03, 0.03, 61))
    return float(fine[np.argmin([_series(clip, time / T, harmonics)[1] for T in fine])])


def cycle_method(
    train: Clips, frame_rate: float, *, mixed: bool, harmonics: int = HARMONICS
) -> Method:
    """Return the forecast by the mean cycle, or by cycles mixed; see the module."""
    cycles = cycles_of(train, frame_rate, harmonics)
    mean = cycles.weights.mean(axis=0)
    others = (cycles.weights - mean) / np.sqrt(max(len(cycles.weights) - 1, 1))
    residuals = [
        clip
        - waves(2.0 * np.pi * np.arange(len(clip)) / T + shift, harmonics)
        @ (own if mixed else mean)
        for clip, own, T, shift in zip(
            train.values(), cycles.weights, cycles.period, cycles.phase, strict=True
        )
    ]
    S, decay = _residual(residuals)
    root = np.linalg.cholesky(S)
    log_period = np.log(cycles.period)
    prior = (float(log_period.mean()), max(float(log_period.std(ddof=1)), 0.005))
    widest = 2.8
    count = max(PERIODS, 1 + int(np.ceil(2.0 * widest * prior[1] / APART)))
    away = np.linspace(-widest, widest, count)
    steps = 2.0 * np.pi / np.exp(prior[0] + prior[1] * away)
    turns = 2.0 * np.pi * np.arange(PHASES) / PHASES
    basis = others if mixed else np.zeros((0, *mean.shape))

    def method(context: np.ndarray, horizon: int) -> Mixture:
        cells = [
            (_cell(context, turn, step, mean, basis, root, decay), turn, step, log_prior)
            for step, log_prior in zip(steps, -0.5 * away**2, strict=True)
            for turn in turns
        ]
        log_mass = np.array([cell[0][0] + cell[3] for cell in cells])
        weight = np.exp(log_mass - log_mass.max())
        weight = weight / weight.sum()
        kept = np.flatnonzero(weight > 1e-5 * weight.max())
        parts = [_ahead(context, horizon, cells[i], mean, basis, np.diag(S), decay) for i in kept]
        sd = np.sqrt(np.stack([v for _, v in parts]) + LEAST_SD**2)
        whole = Mixture(np.stack([m for m, _ in parts]), sd, weight[kept] / weight[kept].sum())
        return thinned(whole, MOST_CELLS)

    return method


def _residual(residuals: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """Return covariance and correlation a frame later of residuals."""
    together = np.concatenate(residuals)
    S = together.T @ together / len(together)
    S = 0.95 * S + 0.05 * np.diag(np.diag(S)) + LEAST_SD**2 * np.eye(len(S))
    products = sum(float(np.sum(r[1:] * r[:-1])) for r in residuals)
    squares = sum(float(np.sum(r[:-1] ** 2)) for r in residuals)
    return S, float(np.clip(products / squares, 0.0, 0.9999))


def _innovations(y: np.ndarray, decay: float) -> np.ndarray:
    """Return what is new at every frame, of unit variance where y is an OU process of one."""
    return np.concatenate([y[:1], (y[1:] - decay * y[:-1]) / np.sqrt(1.0 - decay**2)])


def _cell(
    context: np.ndarray, turn: float, step: float, mean: np.ndarray, basis: np.ndarray,
    root: np.ndarray, decay: float,
) -> tuple[float, np.ndarray, np.ndarray]:  # fmt: skip
    """Return log density of the context in a cell, and mean and root of the mixing weights."""
    F = waves(turn + step * np.arange(len(context)), len(mean) // 2)
    new = np.linalg.solve(root, _innovations(context - F @ mean, decay).T).T.ravel()
    count = len(basis)
    if not count:
        return -0.5 * float(new @ new), np.zeros(0), np.zeros((0, 0))
    A = np.stack([np.linalg.solve(root, _innovations(F @ b, decay).T).T.ravel() for b in basis])
    P = np.eye(count) + A @ A.T
    L = np.linalg.cholesky(P)
    half = np.linalg.solve(L, A @ new)
    log_mass = -0.5 * float(new @ new - half @ half) - float(np.log(np.diag(L)).sum())
    return log_mass, np.linalg.solve(L.T, half), np.linalg.inv(L).T


def _ahead(
    context: np.ndarray, horizon: int, cell: tuple, mean: np.ndarray, basis: np.ndarray,
    variance: np.ndarray, decay: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return mean and variance of the frames to come in a cell."""
    (_, mixing, spread), turn, step, _ = cell
    k = len(context)
    own = mean + np.tensordot(mixing, basis, 1) if len(basis) else mean
    F = waves(turn + step * np.arange(k + horizon), len(mean) // 2)
    left = decay ** np.arange(1, horizon + 1)[:, None]
    ahead = F[k:] @ own + left * (context[-1] - F[k - 1] @ own)
    total = variance * (1.0 - left**2)
    if len(basis):
        each = np.tensordot(spread.T, basis, 1)
        away = np.einsum("hj,cjd->chd", F[k:], each)
        away = away - left * np.einsum("j,cjd->cd", F[k - 1], each)[:, None]
        total = total + np.sum(away**2, axis=0)
    return ahead, total
