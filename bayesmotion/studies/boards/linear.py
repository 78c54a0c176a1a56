"""Linear forecasts, told by training clips alone: points, without a word of how sure they are.

    ridge          of all windows of the training clips, the cosine coefficients of what follows
                   given those of the context; the penalty by leaving out clips
    autoregression   the next frame given the last `LAGS`, in `COMPONENTS` principal components

Both are about the mean of the training clips.
"""

import numpy as np
from jaxtyping import Float
from scipy.fft import dct, idct

from .baselines import hold
from .harness import Clips

PENALTIES = tuple(10.0 ** np.arange(-3.0, 4.0))
COEFFICIENTS = 10
LAGS, COMPONENTS, DAMPING = 3, 6, 1e-3


def ridge(train: Clips, context: Float[np.ndarray, "k d"], horizon: int) -> np.ndarray:
    """Return the frames that follow by ridge regression; the last pose where clips are too short.

    Inputs are scaled to unit mean square.
    """
    k = len(context)
    clips = {name: clip for name, clip in train.items() if len(clip) >= k + horizon}
    if not clips:
        return hold(train, context, horizon)
    mean = np.concatenate([*train.values()]).mean(axis=0)
    windows = {name: _windows(clip - mean, k, horizon) for name, clip in clips.items()}
    inputs, outputs = (np.concatenate([w[i] for w in windows.values()]) for i in (0, 1))
    owner = np.repeat(np.arange(len(windows)), [len(w[0]) for w in windows.values()])
    penalty = PENALTIES[-1]
    if len(clips) > 1:
        penalty = min(PENALTIES, key=lambda one: _left_out(inputs, outputs, owner, one))
    given = _coefficients(context - mean).ravel()
    told = (given @ _weights(inputs, outputs, penalty)).reshape(-1, context.shape[1])
    padded = np.pad(told, ((0, horizon - len(told)), (0, 0)))
    return np.asarray(idct(padded, axis=0, norm="ortho")) + mean


def _coefficients(frames: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "c d"]:
    return np.asarray(dct(frames, axis=0, norm="ortho"))[:COEFFICIENTS]


def _windows(clip: np.ndarray, k: int, horizon: int) -> tuple[np.ndarray, np.ndarray]:
    firsts = range(len(clip) - k - horizon + 1)
    before = [_coefficients(clip[first : first + k]).ravel() for first in firsts]
    after = [_coefficients(clip[first + k : first + k + horizon]).ravel() for first in firsts]
    return np.stack(before), np.stack(after)


def _weights(inputs: np.ndarray, outputs: np.ndarray, penalty: float) -> np.ndarray:
    size = np.mean(inputs**2)
    gram = inputs @ inputs.T + penalty * size * inputs.shape[1] * np.eye(len(inputs))
    return inputs.T @ np.linalg.solve(gram, outputs)


def _left_out(inputs: np.ndarray, outputs: np.ndarray, owner: np.ndarray, penalty: float) -> float:
    """Return the squared error of every clip's windows by the others'."""
    total = 0.0
    for left in np.unique(owner):
        own = owner == left
        total += float(
            np.sum(
                (outputs[own] - inputs[own] @ _weights(inputs[~own], outputs[~own], penalty)) ** 2
            )
        )
    return total


def autoregression(train: Clips, context: Float[np.ndarray, "k d"], horizon: int) -> np.ndarray:
    """Return the frames that follow by an autoregression of principal components."""
    together = np.concatenate([*train.values()])
    mean = together.mean(axis=0)
    axes = np.linalg.svd(together - mean, full_matrices=False)[2][:COMPONENTS].T
    before, after = [], []
    for clip in train.values():
        z = (clip - mean) @ axes
        before += [z[i - LAGS : i].ravel() for i in range(LAGS, len(z))]
        after += [*z[LAGS:]]
    X, Y = np.stack(before), np.stack(after)
    gram = X.T @ X + DAMPING * np.mean(X**2) * np.eye(X.shape[1])
    step = np.linalg.solve(gram, X.T @ Y)
    z = (context - mean) @ axes
    z = np.concatenate([np.repeat(z[:1], max(LAGS - len(z), 0), axis=0), z])
    # What the components leave out of the last pose stays as it is.
    rest = context[-1] - mean - axes @ z[-1]
    for _ in range(horizon):
        z = np.concatenate([z, (z[-LAGS:].ravel() @ step)[None]])
    return z[-horizon:] @ axes.T + mean + rest
