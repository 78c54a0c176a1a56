"""Three plain forecasts that a model has to beat.

All take scaled features of the given frames and give the scaled features of the
frames to come.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float


def hold(y: Float[np.ndarray, "n d"], horizon: int) -> Float[np.ndarray, "h d"]:
    """Keep the last pose."""
    return np.repeat(y[-1:], horizon, axis=0)


def constant_velocity(y: Float[np.ndarray, "n d"], horizon: int) -> Float[np.ndarray, "h d"]:
    """Go on from the last pose at the velocity of the last two frames."""
    return y[-1] + np.arange(1, horizon + 1)[:, None] * (y[-1] - y[-2])


def nearest(
    y: Float[np.ndarray, "n d"], horizon: int, training: Mapping[str, Float[np.ndarray, "m d"]]
) -> Float[np.ndarray, "h d"]:
    """Go on as the training stretch did that looks most like the given frames.

    Only stretches that go on for the whole horizon are considered; if no clip is long
    enough the last pose of the best stretch is held from where its clip ends.
    """
    n = len(y)
    longest = max(len(clip) for clip in training.values())
    room = min(horizon, max(longest - n, 0))
    best, found = np.inf, hold(y, horizon)
    for clip in training.values():
        for first in range(len(clip) - n - room + 1):
            distance = float(np.mean((clip[first : first + n] - y) ** 2))
            if distance < best:
                best = distance
                after = clip[first + n : first + n + room]
                rest = np.repeat(clip[first + n + room - 1 :][:1], horizon - room, axis=0)
                found = np.concatenate([after, rest])
    return found
