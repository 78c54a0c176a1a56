"""The context window a back-constraint sees of its view, and principal components of it.

Frame t sees the frames t - w to t + w of its clip, those farther off less, by
exp(-(lag / lag_scale)^2 / 2); beyond its ends the first and the last frame of a clip go on.
Features count less the later they stand, by exp(-(number / feature_scale)^2 / 2): of cepstra
those that tell fine detail of the spectrum. Principal components of these windows, each of the
size it has, are what the map gets. What is missing stands at its training mean, zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...errors import InputError


@dataclass(frozen=True)
class ContextWindow:
    """Frames around a frame, and how much each of them and of their features counts.

    Parameters
    ----------
    half_width
        Frames on either side, w.
    lag_scale
        Frames until a lag counts exp(-1/2).
    feature_scale
        Features until one counts exp(-1/2).
    components
        At most so many principal components, F.

    Raises
    ------
    InputError
        If a number is not positive.
    """

    half_width: int = 2
    lag_scale: float = 3.0
    feature_scale: float = 10.0
    components: int = 80

    def __post_init__(self) -> None:
        """Check the settings once."""
        positive = min(self.lag_scale, self.feature_scale, self.components) > 0
        if self.half_width < 0 or not positive:
            raise InputError("context window", "a number is not positive", "Use positive ones")

    def __call__(self, scaled: Float[np.ndarray, "t d"]) -> Float[np.ndarray, "t wd"]:
        """Return every frame with those around it."""
        weight = np.exp(-0.5 * (np.arange(scaled.shape[1]) / self.feature_scale) ** 2)
        w = self.half_width
        padded = np.pad(scaled * weight, ((w, w), (0, 0)), mode="edge")
        lags = np.arange(-w, w + 1)
        near = np.exp(-0.5 * (lags / self.lag_scale) ** 2)
        shifted = [padded[w + lag :][: len(scaled)] for lag in lags]
        return np.concatenate([w * part for w, part in zip(near, shifted, strict=True)], axis=1)


@dataclass(frozen=True)
class WindowComponents:
    """Principal components of a clip's windows.

    basis
        ((2 w + 1) D, F) principal components, by columns, over the size they have together.
    mean
        ((2 w + 1) D,) of the windows in training.
    """

    window: ContextWindow
    basis: Float[np.ndarray, "wd f"]
    mean: Float[np.ndarray, " wd"]

    def __call__(self, scaled: Float[np.ndarray, "t d"]) -> Float[np.ndarray, "t f"]:
        """Return the components of a clip of scaled features; NaN counts as zero."""
        return (self.window(np.nan_to_num(scaled)) - self.mean) @ self.basis


def learn_components(
    clips: Sequence[Float[np.ndarray, "_ d"]], window: ContextWindow
) -> WindowComponents:
    """Return the principal components of the windows of training clips."""
    every = np.concatenate([window(np.nan_to_num(clip)) for clip in clips])
    mean = every.mean(axis=0)
    size, directions = np.linalg.eigh(np.cov((every - mean).T))
    order = np.argsort(size)[::-1][: window.components]
    together = np.sqrt(np.mean(np.maximum(size[order], 0.0)))
    return WindowComponents(window, directions[:, order] / together, mean)
