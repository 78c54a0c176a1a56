"""What a model says of entries nobody has seen: for one draw, and averaged over draws.

For one draw of a trained model a `Predictive` gives the moments of every entry, joint
draws, and `marginals`: a simple distribution of every entry by itself. Averaged over S
draws an entry has the density

    p(y) = sum_k w_k p_k(y),

a `Mixture` of normals or a `BernoulliMixture`, which gives mean, standard deviation,
quantiles, draws, log density, probability and the continuous ranked probability score
(Gneiting and Raftery 2007; for mixtures of normals Grimit et al. 2006)

    CRPS = sum_k w_k A(y - m_k, s_k^2) - 1/2 sum_jk w_j w_k A(m_j - m_k, s_j^2 + s_k^2),
    A(m, v) = 2 sqrt(v) phi(m / sqrt(v)) + m (2 Phi(m / sqrt(v)) - 1).

One draw is a mixture of one.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from scipy.special import logsumexp, ndtr
from scipy.stats import norm

from .gp.linalg import AnyArray, cholesky


class NormalEntries(NamedTuple):
    """Every entry normally distributed, by itself: mean and variance (..., N, D)."""

    mean: Float[AnyArray, "*s n d"]
    variance: Float[AnyArray, "*s n d"]


class BernoulliEntries(NamedTuple):
    """Every entry 1 with a probability (..., N, D), else 0."""

    probability: Float[AnyArray, "*s n d"]


@runtime_checkable
class Predictive(Protocol):
    """What one draw of a trained model says of N rows and D features; a pytree."""

    @property
    def mean(self) -> Float[AnyArray, "n d"]:
        """Mean of every entry."""
        ...

    @property
    def variance(self) -> Float[AnyArray, "n d"]:
        """Variance of every entry, noise included."""
        ...

    def marginals(self, key: PRNGKeyArray) -> NormalEntries | BernoulliEntries:
        """Return the distribution of every entry.

        Where it is a mixture of simple ones (a Student t of normals with random scales, a
        mixture of components), it is given one of them, drawn with the key: over many draws
        the average is exact. Several such, alike in weight, stand along a leading axis.
        """
        ...

    def sample(self, key: PRNGKeyArray) -> Float[Array, "n d"]:
        """Draw all entries together, noise included."""
        ...


class IndependentNormal(NamedTuple):
    """Entries that are independent and normal.

    mean, variance
        (N, D), noise included.
    """

    mean: Float[AnyArray, "n d"]
    variance: Float[AnyArray, "n d"]

    def marginals(self, key: PRNGKeyArray) -> NormalEntries:
        """Return mean and variance."""
        return NormalEntries(self.mean, self.variance)

    def sample(self, key: PRNGKeyArray) -> Float[Array, "n d"]:
        """Draw all entries."""
        white = jax.random.normal(key, jnp.shape(self.mean))
        return jnp.asarray(self.mean) + jnp.sqrt(self.variance) * white


class GPPredictive(NamedTuple):
    """Columns that are independent Gaussian processes, those of a pattern with one covariance.

    Column d of the outputs is N(mean_d, lambda_d (covariance_p + noise I) / scale_d^2), with
    lambda_d = 1, or where `residual_scale` is given inverse gamma.

    mean
        (N, D).
    covariance
        (P, N, N) of the noise-free outputs of scale 1, one a pattern.
    noise
        Variance of the noise of an output of scale 1.
    scale
        (D,) of the columns: the larger, the smaller the column.
    columns
        (P, D) which columns a covariance is for.
    residual_scale
        Shape and rate (D,) each of lambda_d; None for one.
    """

    mean: Float[AnyArray, "n d"]
    covariance: Float[AnyArray, "p n n"]
    noise: Float[AnyArray, ""]
    scale: Float[AnyArray, " d"]
    columns: Float[AnyArray, "p d"]
    residual_scale: tuple[Float[AnyArray, " d"], Float[AnyArray, " d"]] | None = None

    @property
    def variance(self) -> Float[AnyArray, "n d"]:
        """Variance of every entry, noise included."""
        if self.residual_scale is None:
            return self._normal()
        shape, rate = self.residual_scale
        return self._normal() * rate / (shape - 1.0)

    def marginals(self, key: PRNGKeyArray) -> NormalEntries:
        """Return mean and variance, given a draw of lambda."""
        return self.marginals_of(self.widening(key))

    def marginals_of(self, widening: Float[AnyArray, " d"] | float) -> NormalEntries:
        """Return mean and variance, given lambda."""
        return NormalEntries(self.mean, self._normal() * widening)

    def sample(self, key: PRNGKeyArray) -> Float[Array, "n d"]:
        """Draw all entries together: columns over time as the process has them."""
        key, white_key = jax.random.split(key)
        white = jax.random.normal(white_key, self.mean.shape)
        return self.sample_of(white, self.widening(key))

    def sample_of(
        self, white: Float[AnyArray, "n d"], widening: Float[AnyArray, " d"] | float
    ) -> Float[Array, "n d"]:
        """Return the draw that is made of standard normal numbers, given lambda."""
        noisy = jnp.asarray(self.covariance) + self.noise * jnp.eye(len(self.mean))
        roots = jax.vmap(cholesky)(noisy)
        drawn = jnp.einsum("pnm,md,pd->nd", roots, white, self.columns)
        return jnp.asarray(self.mean) + drawn * jnp.sqrt(widening) / self.scale

    def widening(self, key: PRNGKeyArray) -> Float[AnyArray, " d"] | float:
        """Draw lambda, what the covariance of every column is multiplied by."""
        if self.residual_scale is None:
            return 1.0
        shape, rate = self.residual_scale
        return rate / jax.random.gamma(key, shape)

    def _normal(self) -> Float[AnyArray, "n d"]:
        diagonal = jnp.diagonal(self.covariance, axis1=1, axis2=2) + self.noise
        return jnp.einsum("pn,pd->nd", diagonal, self.columns) / self.scale**2


class Bernoulli(NamedTuple):
    """Entries that are independent and 0 or 1: the probability (N, D) of 1."""

    mean: Float[AnyArray, "n d"]

    @property
    def variance(self) -> Float[AnyArray, "n d"]:
        """Variance of every entry."""
        return self.mean * (1.0 - self.mean)

    def marginals(self, key: PRNGKeyArray) -> BernoulliEntries:
        """Return the probabilities."""
        return BernoulliEntries(self.mean)

    def sample(self, key: PRNGKeyArray) -> Float[Array, "n d"]:
        """Draw all entries."""
        return jax.random.bernoulli(key, jnp.asarray(self.mean)).astype(float)


@dataclass(frozen=True)
class Mixture:
    """Entries (N, D) whose distributions are S weighted normals.

    mean, sd
        (S, N, D).
    weight
        (S,), adding up to one.
    """

    mean: Float[np.ndarray, "s n d"]
    sd: Float[np.ndarray, "s n d"]
    weight: Float[np.ndarray, " s"]

    def means(self) -> Float[np.ndarray, "n d"]:
        """Return the mean of every entry."""
        return _weighted(self.weight, self.mean)

    def sds(self) -> Float[np.ndarray, "n d"]:
        """Return the standard deviation of every entry, that of the means included."""
        away = self.mean - self.means()
        return np.sqrt(_weighted(self.weight, self.sd**2 + away**2))

    def probability(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Return the probability of a value of at most y, entry by entry (the PIT of y)."""
        return _weighted(self.weight, ndtr((y - self.mean) / self.sd))

    def quantile(self, probability: float, steps: int = 40) -> Float[np.ndarray, "n d"]:
        """Return the quantile of every entry, by bisection."""
        out = norm.ppf(probability, self.mean, self.sd)
        low, high = out.min(axis=0), out.max(axis=0)
        if len(out) == 1:
            return low
        for _ in range(steps):
            middle = 0.5 * (low + high)
            below = self.probability(middle) < probability
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return 0.5 * (low + high)

    def log_density(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Return the log density of y, entry by entry."""
        each = norm.logpdf(y, self.mean, self.sd)
        return np.asarray(logsumexp(each, axis=0, b=self.weight[:, None, None]))

    def crps(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Return the continuous ranked probability score of y, entry by entry; small is good."""
        score = _weighted(self.weight, _mean_absolute(y - self.mean, self.sd**2))
        for weight, mean, sd in zip(self.weight, self.mean, self.sd, strict=True):
            between = _mean_absolute(mean - self.mean, sd**2 + self.sd**2)
            score -= 0.5 * weight * _weighted(self.weight, between)
        return score

    def part(self, frames: slice, features: slice | np.ndarray) -> "Mixture":
        """Return some of the rows and features."""
        mean, sd = (a[:, frames][:, :, features] for a in (self.mean, self.sd))
        return Mixture(mean, sd, self.weight)

    def rescaled(self, location: np.ndarray, scale: np.ndarray) -> "Mixture":
        """Return that of ``location + scale * y``."""
        return Mixture(location + scale * self.mean, np.abs(scale) * self.sd, self.weight)


@dataclass(frozen=True)
class BernoulliMixture:
    """Entries (N, D) that are 0 or 1, by S weighted probabilities of 1 (S, N, D)."""

    each: Float[np.ndarray, "s n d"]
    weight: Float[np.ndarray, " s"]

    def means(self) -> Float[np.ndarray, "n d"]:
        """Return the probability of 1."""
        return _weighted(self.weight, self.each)

    def sds(self) -> Float[np.ndarray, "n d"]:
        """Return the standard deviation of every entry."""
        p = self.means()
        return np.sqrt(p * (1.0 - p))

    def probability(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Return the probability of a value of at most y."""
        return np.where(y >= 1.0, 1.0, np.where(y >= 0.0, 1.0 - self.means(), 0.0))

    def quantile(self, probability: float) -> Float[np.ndarray, "n d"]:
        """Return the quantile of every entry: 0 or 1."""
        return (1.0 - self.means() < probability).astype(float)

    def log_density(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Return the log probability of y, entry by entry."""
        p = self.means()
        return np.log(np.where(y > 0.5, p, 1.0 - p))

    def crps(self, y: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Return the squared error of the probability (Brier), which the CRPS is here."""
        return (self.means() - y) ** 2

    def part(self, frames: slice, features: slice | np.ndarray) -> "BernoulliMixture":
        """Return some of the rows and features."""
        return BernoulliMixture(self.each[:, frames][:, :, features], self.weight)

    def rescaled(self, location: np.ndarray, scale: np.ndarray) -> "BernoulliMixture":
        """Return itself: 0 and 1 have no units."""
        return self


def mixture_of(
    entries: NormalEntries | BernoulliEntries, weight: Float[np.ndarray, " s"]
) -> Mixture | BernoulliMixture:
    """Return the mixture of the entries' distributions, stacked along a leading axis."""
    if isinstance(entries, BernoulliEntries):
        return BernoulliMixture(np.asarray(entries.probability), weight)
    return Mixture(np.asarray(entries.mean), np.sqrt(np.asarray(entries.variance)), weight)


def stacked(mixtures: list[Mixture], weights: Float[np.ndarray, " m"]) -> Mixture:
    """Mix the forecasts of several models by their weights."""
    mean, sd = (np.concatenate([getattr(m, name) for m in mixtures]) for name in ("mean", "sd"))
    weight = np.concatenate([w * m.weight for w, m in zip(weights, mixtures, strict=True)])
    return Mixture(mean, sd, weight)


COVERAGES = (0.5, 0.8, 0.9, 0.95)


@dataclass(frozen=True)
class Scores:
    """How good a forecast was.

    error
        Mean over the frames of the norm of the mean's error over the features.
    crps, log_score
        Means over the entries.
    coverage
        For each of `COVERAGES` the share of the entries in their central interval.
    """

    error: float
    crps: float
    log_score: float
    coverage: dict[float, float]

    @property
    def coverage90(self) -> float:
        """Share of the entries in their central 90 % interval."""
        return self.coverage[0.9]

    def figures(self) -> dict[str, float]:
        """Return all of them by name: ``error``, ``crps``, ``log_score``, ``coverage50``, ..."""
        shares = {f"coverage{100 * share:.0f}": held for share, held in self.coverage.items()}
        own = {"error": self.error, "crps": self.crps, "log_score": self.log_score}
        return own | shares


def score(forecast: Mixture, true: Float[np.ndarray, "n d"]) -> Scores:
    """Score a forecast by what happened."""
    error = np.linalg.norm(forecast.means() - true, axis=1)
    away = np.abs(forecast.probability(true) - 0.5)
    return Scores(
        float(error.mean()),
        float(forecast.crps(true).mean()),
        float(forecast.log_density(true).mean()),
        {share: float((away <= 0.5 * share).mean()) for share in COVERAGES},
    )


def _weighted(weight: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.tensordot(weight, values, 1)


def _mean_absolute(mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Mean absolute value of a normal variable."""
    sd = np.sqrt(variance)
    z = mean / sd
    return 2.0 * sd * norm.pdf(z) + mean * (2.0 * norm.cdf(z) - 1.0)


__all__ = [
    "COVERAGES",
    "Bernoulli",
    "BernoulliEntries",
    "BernoulliMixture",
    "GPPredictive",
    "IndependentNormal",
    "Mixture",
    "NormalEntries",
    "Predictive",
    "Scores",
    "mixture_of",
    "score",
    "stacked",
]
