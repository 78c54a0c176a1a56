"""Scores of probability forecasts: mixtures of normal distributions, entry by entry.

A forecast averaged over S draws gives every entry the density

    p(y) = 1/S sum_k N(y; m_k, s_k^2)        (weights w_k where models are stacked)

and is scored by the continuous ranked probability score (Gneiting and Raftery 2007;
for mixtures Grimit et al. 2006),

    CRPS = sum_k w_k A(y - m_k, s_k^2) - 1/2 sum_jk w_j w_k A(m_j - m_k, s_j^2 + s_k^2),
    A(m, v) = 2 sqrt(v) phi(m / sqrt(v)) + m (2 Phi(m / sqrt(v)) - 1),

by the logarithm of p(y), and by how often its central intervals hold the truth.
One draw is a mixture of one.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp
from scipy.stats import norm


@dataclass(frozen=True)
class Mixture:
    """Forecast of N frames and D features by S weighted normal distributions.

    mean, sd
        (S, N, D).
    weight
        (S,), adding up to one.
    """

    mean: Float[np.ndarray, "s n d"]
    sd: Float[np.ndarray, "s n d"]
    weight: Float[np.ndarray, " s"]

    def means(self) -> Float[np.ndarray, "n d"]:
        """Mean of every entry."""
        return np.tensordot(self.weight, self.mean, 1)

    def sds(self) -> Float[np.ndarray, "n d"]:
        """Standard deviation of every entry, the spread of the means included."""
        second = np.tensordot(self.weight, self.sd**2 + self.mean**2, 1)
        return np.sqrt(np.maximum(second - self.means() ** 2, 0.0))

    def probability(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Probability of a value of at most y, entry by entry (the PIT of a truth y)."""
        return np.tensordot(self.weight, norm.cdf((y - self.mean) / self.sd), 1)

    def log_density(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Log density of y, entry by entry."""
        each = norm.logpdf(y, self.mean, self.sd)
        return np.asarray(logsumexp(each, axis=0, b=self.weight[:, None, None]))

    def crps(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Continuous ranked probability score of y, entry by entry; the smaller the better."""
        score = np.tensordot(self.weight, _spread(y - self.mean, self.sd**2), 1)
        for weight, mean, sd in zip(self.weight, self.mean, self.sd, strict=True):
            between = _spread(mean - self.mean, sd**2 + self.sd**2)
            score -= 0.5 * weight * np.tensordot(self.weight, between, 1)
        return score

    def part(self, frames: slice, features: slice) -> "Mixture":
        """Take some of the frames and features."""
        return Mixture(self.mean[:, frames, features], self.sd[:, frames, features], self.weight)


def stacked(mixtures: list[Mixture], weights: Float[np.ndarray, " m"]) -> Mixture:
    """Mix the forecasts of several models by their weights."""
    mean, sd = (np.concatenate([getattr(m, name) for m in mixtures]) for name in ("mean", "sd"))
    weight = np.concatenate([w * m.weight for w, m in zip(weights, mixtures, strict=True)])
    return Mixture(mean, sd, weight)


@dataclass(frozen=True)
class Scores:
    """How good a forecast was.

    error
        Mean over the frames of the norm of the mean's error over the features.
    crps, log_score
        Means over the entries.
    coverage90
        Share of the entries in their central 90 % interval.
    """

    error: float
    crps: float
    log_score: float
    coverage90: float


def score(forecast: Mixture, true: Float[np.ndarray, "n d"]) -> Scores:
    """Score a forecast by what happened."""
    error = np.linalg.norm(forecast.means() - true, axis=1)
    inside = np.abs(forecast.probability(true) - 0.5) <= 0.45
    return Scores(
        float(error.mean()),
        float(forecast.crps(true).mean()),
        float(forecast.log_density(true).mean()),
        float(inside.mean()),
    )


def _spread(mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Mean absolute value of a normal variable."""
    sd = np.sqrt(variance)
    z = mean / sd
    return 2.0 * sd * norm.pdf(z) + mean * (2.0 * norm.cdf(z) - 1.0)
