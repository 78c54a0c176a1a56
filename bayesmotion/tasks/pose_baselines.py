"""What a gait-pose model has to beat: mean cycle, principal components, nearest pose, smoother."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.signal import savgol_filter

WINDOWS = (5, 7, 9, 11, 13)
DEGREE = 3


@dataclass(frozen=True)
class PosePCA:
    """Probabilistic principal components (Tipping and Bishop 1999) of training poses.

    mean
        (D,).
    loadings
        (D, Q).
    noise
        Mean variance of the components left out.
    """

    mean: Float[np.ndarray, " d"]
    loadings: Float[np.ndarray, "d q"]
    noise: float

    def fill(
        self, u: Float[np.ndarray, "t d"], seen: Bool[np.ndarray, "t d"]
    ) -> Float[np.ndarray, "t d"]:
        """Expected poses given what is seen of each, all features by the components."""
        out = np.empty_like(u)
        for t, known in enumerate(seen):
            W = self.loadings[known]
            gram = W.T @ W + self.noise * np.eye(W.shape[1])
            z = np.linalg.solve(gram, W.T @ (u[t, known] - self.mean[known]))
            out[t] = self.mean + self.loadings @ z
        return out


def fit_pca(y: Float[np.ndarray, "n d"], count: int) -> PosePCA:
    """Fit principal components by maximum likelihood."""
    mean = y.mean(axis=0)
    _, s, Vt = np.linalg.svd(y - mean, full_matrices=False)
    variance = s**2 / len(y)
    noise = float(variance[count:].mean())
    return PosePCA(mean, Vt[:count].T * np.sqrt(np.maximum(variance[:count] - noise, 0.0)), noise)


def mean_cycle(cycles: Float[np.ndarray, "c t d"]) -> Float[np.ndarray, "t d"]:
    """Return the mean of training cycles, pose by pose: what a walk is at that phase."""
    return cycles.mean(axis=0)


def nearest_pose(
    y: Float[np.ndarray, "n d"], u: Float[np.ndarray, "t d"], seen: Bool[np.ndarray, "t d"]
) -> Float[np.ndarray, "t d"]:
    """The training pose nearest to each by what is seen of it."""
    known = np.where(seen, u, 0.0)
    square = np.sum(seen[:, None] * (known[:, None] - y[None]) ** 2, axis=-1)
    return y[np.argmin(square, axis=1)]


def smoothed(u: Float[np.ndarray, "t d"], window: int) -> Float[np.ndarray, "t d"]:
    """Savitzky-Golay filter along a cycle, which closes."""
    return np.asarray(savgol_filter(u, window, DEGREE, axis=0, mode="wrap"))


def best_window(cycles: Float[np.ndarray, "c t d"], noisy: Float[np.ndarray, "c t d"]) -> int:
    """The window that leaves the least of the noise in training cycles."""

    def error(window: int) -> float:
        made = [smoothed(cycle, window) for cycle in noisy]
        return float(np.mean((np.array(made) - cycles) ** 2))

    return min(WINDOWS, key=error)
