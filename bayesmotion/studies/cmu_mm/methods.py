"""Forecasts of windows: of the contexts, and of what training windows tell.

    zero        the last pose
    nearest     what followed the training context most alike, from the last pose on
    ridge       linear in the context, relative to the last pose, a penalty for all
    process     a Gaussian process of the context

All but the first predict the way from the last pose. A process's input u is the frames before
relative to the last pose, beside `pose_weight` times the last pose, of mean square one over the
training windows; every entry of every frame ahead is a Gaussian process with

    k(u, u') = (1 + |u - u'|^2 / (2 l^2))^-1 + a u.u' + noise      (rational quadratic and linear)

of a scale of its own, its mean square under K^-1. `error_scale` widens it at each frame ahead to
how far it errs on training files that are left out.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve

from .data import HORIZON, Windows

LEAST_SD_MM = 0.1


class Process(NamedTuple):
    """Settings of the process.

    pose_weight
        What the last pose counts beside the way to it.
    length
        l, of inputs of mean square one.
    noise
        Variance of the noise, of the kernel's.
    linear
        a, of the linear part.
    """

    pose_weight: float
    length: float
    noise: float
    linear: float


class Told(NamedTuple):
    """A forecast (W, 25, E) of windows in mm: mean, and sd or None where it has none."""

    mean: Float[np.ndarray, "w h e"]
    sd: Float[np.ndarray, "w h e"] | None


def zero(train: Windows, context: Float[np.ndarray, "w k e"]) -> Told:
    """Return the last pose, again and again."""
    return Told(np.repeat(context[:, -1:], HORIZON, axis=1), None)


def nearest(train: Windows, context: Float[np.ndarray, "w k e"]) -> Told:
    """Return the last pose and what followed the training context most alike."""
    here, known = (c.reshape(len(c), -1) for c in (context, train.context))
    chosen = _squares(here, known).argmin(axis=1)
    return Told(context[:, -1:] + _way(train)[chosen], None)


def ridge(train: Windows, context: Float[np.ndarray, "w k e"], penalty: float) -> Told:
    """Return the linear forecast by all 10 poses."""
    relative, last = _inputs(train.context)
    X = np.concatenate([relative, last, np.ones((len(last), 1))], axis=1)
    weights = np.linalg.solve(X.T @ X + penalty * np.eye(X.shape[1]), X.T @ _flat(_way(train)))
    relative, last = _inputs(context)
    X = np.concatenate([relative, last, np.ones((len(last), 1))], axis=1)
    return Told(context[:, -1:] + (X @ weights).reshape(len(X), HORIZON, -1), None)


def process(
    train: Windows,
    context: Float[np.ndarray, "w k e"],
    settings: Process,
    error_scale: Float[np.ndarray, " h"] | None = None,
) -> Told:
    """Return the forecast of the process; see the module.

    Parameters
    ----------
    train
        Training windows.
    context
        Of the windows to forecast.
    settings
        Of the process.
    error_scale
        (25,) what its sd is multiplied by at each frame ahead; None: one.
    """
    known, here = _process_inputs(train.context, context, settings.pose_weight)
    target = _flat(_way(train))
    factor = cho_factor(_kernel(known, known, settings) + settings.noise * np.eye(len(known)))
    solved = cho_solve(factor, target)
    cross = _kernel(here, known, settings)
    mean = context[:, -1:] + (cross @ solved).reshape(len(here), HORIZON, -1)
    scale = np.mean(target * solved, axis=0).reshape(HORIZON, -1)
    own = 1.0 + settings.linear * np.sum(here**2, axis=1)
    left = own - np.sum(cross * cho_solve(factor, cross.T).T, axis=1) + settings.noise
    sd = np.sqrt(left[:, None, None] * scale + LEAST_SD_MM**2)
    return Told(mean, sd if error_scale is None else sd * error_scale[:, None])


def _process_inputs(
    train: np.ndarray, context: np.ndarray, pose_weight: float
) -> tuple[np.ndarray, np.ndarray]:
    mean = train[:, -1].mean(axis=0)
    known, here = (
        np.concatenate([relative, pose_weight * (last - mean)], axis=1)
        for relative, last in (_inputs(train), _inputs(context))
    )
    size = np.sqrt(np.mean(np.sum(known**2, axis=1)))
    return known / size, here / size


def _inputs(context: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the frames before relative to the last pose (W, 9 E), and that."""
    last = context[:, -1]
    return (context[:, :-1] - last[:, None]).reshape(len(context), -1), last


def _way(train: Windows) -> np.ndarray:
    return train.future - train.context[:, -1:]


def _flat(values: np.ndarray) -> np.ndarray:
    return values.reshape(len(values), -1)


def _kernel(one: np.ndarray, other: np.ndarray, settings: Process) -> np.ndarray:
    smooth = 1.0 / (1.0 + _squares(one, other) / (2.0 * settings.length**2))
    return smooth + settings.linear * one @ other.T


def _squares(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    squares = np.sum(one**2, axis=1)[:, None] + np.sum(other**2, axis=1) - 2.0 * one @ other.T
    return np.maximum(squares, 0.0)
