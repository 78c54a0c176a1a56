"""Plain regressions from a window of sound to the face, to compare models with.

    ridge           y = mean + a B, B with a penalty, a the window of 11 frames
    gp_regression   y_d ~ GP(mean, k), k a Gaussian kernel of the 80 main components of the
                    window of 17 frames, plus noise

Features are scaled to unit spread.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..gp.kernels import Kernel, Points, rbf
from ..gp.matrix_normal import Conditioned, complete, condition
from ..models.shared_gplvm import ContextWindow

PENALTY = 100.0
RIDGE_WINDOW = ContextWindow(5, np.inf, np.inf)
GP_WINDOW = ContextWindow(8, np.inf, np.inf, 80)
LENGTH = 0.9  # of the components' root mean square distance from their mean
NOISE = 0.1  # variance, of an output whose function has variance one


@dataclass(frozen=True)
class Windows:
    """How sound is scaled, and the window of it."""

    window: ContextWindow
    middle: Float[np.ndarray, " a"]
    spread: Float[np.ndarray, " a"]

    def __call__(self, sound: Float[np.ndarray, "t a"]) -> Float[np.ndarray, "t wa"]:
        """Give the windows of sound features."""
        return self.window((sound - self.middle) / self.spread)


def windows_of(sound: Sequence[Float[np.ndarray, "_ a"]], window: ContextWindow) -> Windows:
    """Scale sounds as training clips are spread."""
    every = np.concatenate(sound)
    return Windows(window, every.mean(axis=0), every.std(axis=0))


@dataclass(frozen=True)
class Ridge:
    """Linear regression with a penalty."""

    windows: Windows
    middle: Float[np.ndarray, " wa"]
    mean: Float[np.ndarray, " d"]
    weights: Float[np.ndarray, "wa d"]

    def speak(self, sound: Float[np.ndarray, "t a"]) -> Float[np.ndarray, "t d"]:
        """Make the face of sound features."""
        return self.mean + (self.windows(sound) - self.middle) @ self.weights


def train_ridge(
    sound: Sequence[Float[np.ndarray, "_ a"]], face: Sequence[Float[np.ndarray, "_ d"]]
) -> Ridge:
    """Train on clips."""
    windows, y = windows_of(sound, RIDGE_WINDOW), np.concatenate(face)
    a = np.concatenate([windows(clip) for clip in sound])
    middle, mean = a.mean(axis=0), y.mean(axis=0)
    gram = (a - middle).T @ (a - middle) + PENALTY * np.eye(a.shape[1])
    return Ridge(windows, middle, mean, np.linalg.solve(gram, (a - middle).T @ (y - mean)))


@dataclass(frozen=True)
class Regression:
    """Gaussian process regression from principal components of the window."""

    windows: Windows
    middle: Float[np.ndarray, " wa"]
    basis: Float[np.ndarray, "wa f"]
    mean: Float[np.ndarray, " d"]
    spread: Float[np.ndarray, " d"]
    kernel: Kernel
    points: Points
    conditioned: Conditioned

    def speak(
        self, sound: Float[np.ndarray, "t a"]
    ) -> tuple[Float[np.ndarray, "t d"], Float[np.ndarray, "t d"]]:
        """Make the face of sound features, and standard deviations."""
        x = (self.windows(sound) - self.middle) @ self.basis
        new = {"x": jnp.asarray(x)}
        cross, own = self.kernel.matrix(new, self.points), self.kernel.matrix(new, new)
        mean, covariance = self.conditioned(cross, own)
        variance = np.diagonal(np.asarray(covariance[0]))
        deviation = np.sqrt(variance[:, None] + NOISE) * self.spread
        return self.mean + np.asarray(mean) * self.spread, deviation


def train_regression(
    sound: Sequence[Float[np.ndarray, "_ a"]], face: Sequence[Float[np.ndarray, "_ d"]]
) -> Regression:
    """Train on clips."""
    windows, y = windows_of(sound, GP_WINDOW), np.concatenate(face)
    a = np.concatenate([windows(clip) for clip in sound])
    middle = a.mean(axis=0)
    directions = np.linalg.svd(a - middle, full_matrices=False)[2][: GP_WINDOW.components].T
    x = (a - middle) @ directions
    size = float(np.sqrt(np.mean(np.sum(x**2, axis=1))))
    mean, spread = y.mean(axis=0), y.std(axis=0)
    kernel = rbf("x", length_scale=LENGTH)
    points = {"x": jnp.asarray(x / size)}
    K = kernel.matrix(points, points) + NOISE * jnp.eye(len(x))
    conditioned = condition((y - mean) / spread, K, complete(*y.shape))
    return Regression(windows, middle, directions / size, mean, spread, kernel, points, conditioned)
