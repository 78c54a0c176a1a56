"""What a Gaussian process model makes of poses nobody has seen: eq. 15 of Ding and Fan.

A new cycle has latent points x_1 .. x_T and poses y_t; what is measured, u_t, may lack
entries and be noisy:

    p(y, x | u) ~ p(u | y) p(y | x) p(x)

    u_td = y_td + noise_td                where entry d of pose t is seen
    y_t  = f(x_t) + d_t                   f: the trained process; d: what is the new person's
    p(x)                                  of the trained model (`PoseModel.log_prior`)

x is found by its mode with d as white noise of the variance that `Deviation` says it
has (`represent`); then y has a normal distribution given x and u (`pose_given`), in which
d goes smoothly through the cycle and its features hang together.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..gp.linalg import AnyArray
from ..inference.optimise import maximise

# Variance that what is exact has all the same, so that no covariance is singular.
TINY = 1e-8
STARTS, KEEP, STEPS, TRIAL = 2, 1, 25, 5


@runtime_checkable
class PoseModel(Protocol):
    """A trained model as these tasks see it: a pytree, so that one compilation serves all.

    candidates
        (C, T, Q) latent paths of whole cycles, where a search may begin.
    """

    @property
    def candidates(self) -> Float[AnyArray, "c t q"]:
        """Latent paths to begin from."""
        ...

    def predict(self, x: Float[AnyArray, "t q"]) -> tuple[AnyArray, AnyArray]:
        """Mean and variance (T, D) of the process at latent points."""
        ...

    def log_prior(self, x: Float[AnyArray, "t q"]) -> Float[AnyArray, ""]:
        """Log density, up to a constant, of a latent path."""
        ...


class Measured(NamedTuple):
    """What is measured of one cycle.

    u
        (T, D) features, anything where not seen.
    seen
        (T, D) 1 where seen, else 0.
    noise
        (T, D) variance of each entry's noise, zero where it is exact.
    """

    u: Float[AnyArray, "t d"]
    seen: Float[AnyArray, "t d"]
    noise: Float[AnyArray, "t d"]


def measured(
    u: Float[np.ndarray, "t d"],
    seen: Bool[np.ndarray, "t d"] | None = None,
    noise: Float[np.ndarray, " d"] | float = 0.0,
) -> Measured:
    """Put what is measured together; NaN is not seen.

    Parameters
    ----------
    u
        Features.
    seen
        Which entries to look at, all where None.
    noise
        Standard deviation of the noise of each feature.
    """
    known = np.isfinite(u) if seen is None else np.isfinite(u) & seen
    variance = np.broadcast_to(np.asarray(noise, float) ** 2, u.shape)
    return Measured(np.where(known, u, 0.0), known.astype(float), np.array(variance))


@dataclass(frozen=True)
class Represented:
    """What `represent` found.

    x
        (T, Q) latent points.
    mean, variance
        (T, D) of the process there.
    log_density
        Of the mode.
    """

    x: Float[np.ndarray, "t q"]
    mean: Float[np.ndarray, "t d"]
    variance: Float[np.ndarray, "t d"]
    log_density: float


@dataclass(frozen=True)
class _PathDensity:
    """log p(u | x) + log p(x) with white deviations; equal ones share a compilation."""

    def __call__(self, values: dict[str, Any], data: tuple) -> Array:
        model, given, white = data
        x = values["x"]
        mean, variance = model.predict(x)
        spread = variance + white + given.noise
        each = -0.5 * ((given.u - mean) ** 2 / spread + jnp.log(spread))
        return jnp.sum(given.seen * each) + model.log_prior(x)


class Candidates(NamedTuple):
    """Latent paths a search may begin from, and what the process says there.

    x
        (C, T, Q).
    mean, variance
        (C, T, D).
    log_prior
        (C,).
    """

    x: Float[AnyArray, "c t q"]
    mean: Float[AnyArray, "c t d"]
    variance: Float[AnyArray, "c t d"]
    log_prior: Float[AnyArray, " c"]


@jax.jit
def candidates_of(model: PoseModel) -> Candidates:
    """Predict at a model's candidates, once for all searches."""
    x = jnp.asarray(model.candidates)
    mean, variance = jax.lax.map(model.predict, x)
    return Candidates(x, mean, variance, jax.lax.map(model.log_prior, x))


def _scores(candidates: Candidates, given: Measured, white: np.ndarray) -> np.ndarray:
    """Log density of what is measured at every candidate."""
    spread = np.asarray(candidates.variance) + white + given.noise
    off = (given.u - np.asarray(candidates.mean)) ** 2 / spread + np.log(spread)
    return -0.5 * np.sum(given.seen * off, axis=(1, 2)) + np.asarray(candidates.log_prior)


def represent(
    model: PoseModel,
    given: Measured,
    white: Float[AnyArray, " d"],
    max_steps: int = STEPS,
    candidates: Candidates | None = None,
) -> Represented:
    """Find the latent path of a cycle.

    Parameters
    ----------
    model
        A trained model.
    given
        What is measured of the cycle.
    white
        (D,) variance of what is the person's own in each feature.
    max_steps
        At most so many L-BFGS steps.
    candidates
        Those of the model, where they are at hand.
    """
    known = candidates_of(model) if candidates is None else candidates
    best = np.argsort(-_scores(known, given, np.asarray(white)))[:STARTS]
    starts = {"x": jnp.asarray(known.x)[best]}
    data = (model, Measured(*map(jnp.asarray, given)), jnp.asarray(white))
    optimum = maximise(
        _PathDensity(),
        starts,
        data,
        max_steps=max_steps,
        keep=KEEP,
        trial_steps=TRIAL,
        tolerance=1e-6,
    )
    x = np.asarray(optimum.best()["x"])
    mean, variance = _predicted(model, x)
    return Represented(x, np.asarray(mean), np.asarray(variance), float(optimum.log_density[0]))


@jax.jit
def _predicted(model: PoseModel, x: AnyArray) -> tuple[AnyArray, AnyArray]:
    return model.predict(x)


class Deviation(NamedTuple):
    """How a new person's cycles differ from what the process makes of them.

    The deviation d (T, D) is matrix-normal, its covariance ``time x features``.

    features
        (D, D) covariance between features.
    time
        (T, T) correlation between poses of a cycle.
    usual
        Variance of the process that is counted in already: what it has above that comes
        on top.
    """

    features: Float[AnyArray, "d d"]
    time: Float[AnyArray, "t t"]
    usual: Float[AnyArray, ""]

    @property
    def white(self) -> Float[AnyArray, " d"]:
        """Variance of each feature."""
        return jnp.diagonal(jnp.asarray(self.features))


@dataclass(frozen=True)
class Pose:
    """A distribution of the poses of a cycle.

    mean, sd
        (T, D) of every feature.
    log_density
        Log density of what was measured, at the latent path found.
    """

    mean: Float[np.ndarray, "t d"]
    sd: Float[np.ndarray, "t d"]
    log_density: float


def pose_given(found: Represented, given: Measured, deviation: Deviation) -> Pose:
    """Give the poses of a cycle, given the latent path and what was measured.

    Parameters
    ----------
    found
        The latent path, and what the process says there.
    given
        What is measured.
    deviation
        What is the person's own.
    """
    # What the process has above its usual variance, no two entries share.
    above = float(np.mean(np.maximum(found.variance - float(deviation.usual), 0.0)))
    seen, noise = np.asarray(given.seen) > 0, np.asarray(given.noise) + TINY
    features, time = np.asarray(deviation.features), np.asarray(deviation.time)
    same = (seen == seen[:1]).all() and (noise == noise[:1]).all()
    if same:
        columns = np.flatnonzero(seen[0])
        residual = np.asarray(given.u)[:, columns] - found.mean[:, columns]
        parts = _by_axes(residual, columns, noise[0], above, features, time)
    else:
        residual = np.asarray(given.u) - found.mean
        parts = _by_entries(residual, seen, noise, above, features, time)
    shift, variance, log_density = parts
    return Pose(found.mean + shift, np.sqrt(np.maximum(variance, 0.0)), log_density)


Parts = tuple[np.ndarray, np.ndarray, float]


def _by_axes(
    residual: Float[np.ndarray, "t k"],
    columns: np.ndarray,
    noise: Float[np.ndarray, " d"],
    above: float,
    features: Float[np.ndarray, "d d"],
    time: Float[np.ndarray, "t t"],
) -> Parts:
    """Condition where the same features are seen all through the cycle, equally well.

    The covariance time x features + I x W, with W the variance of what is white, becomes
    diagonal by the eigenvectors of time and those of W^(-1/2) features W^(-1/2): what
    costs (T D)^3 as a whole costs T^3 + D^3.
    """
    white = noise[columns] + above
    M, P = np.linalg.eigh(time)
    shrunk = features[np.ix_(columns, columns)] / np.sqrt(white[:, None] * white)
    size, Q = np.linalg.eigh(shrunk)
    back = Q / np.sqrt(white)[:, None]
    total = M[:, None] * size[None, :] + 1.0
    turned = P.T @ residual @ back
    weights = P @ (turned / total) @ back.T
    shift = time @ weights @ features[columns]
    shift[:, columns] += above * weights
    # Covariance of what is measured with every feature, turned the same way.
    shared = back.T @ features[columns]
    own = np.zeros_like(shared)
    own[:, columns] = above * back.T
    gain = (M[:, None, None] * shared + own) ** 2 / total[:, :, None]
    explained = P**2 @ gain.sum(axis=1)
    variance = np.outer(np.diag(time), np.diag(features)) + above - explained
    logdet = np.sum(np.log(total)) + len(time) * np.sum(np.log(white))
    constant = residual.size * np.log(2.0 * np.pi)
    return shift, variance, float(-0.5 * (np.sum(turned**2 / total) + logdet + constant))


def _by_entries(
    residual: Float[np.ndarray, "t d"],
    seen: Bool[np.ndarray, "t d"],
    noise: Float[np.ndarray, "t d"],
    above: float,
    features: Float[np.ndarray, "d d"],
    time: Float[np.ndarray, "t t"],
) -> Parts:
    """Condition on whatever entries are seen, by one large covariance."""
    own = np.kron(time, features) + above * np.eye(seen.size)
    known = np.flatnonzero(seen)
    K = own[np.ix_(known, known)] + np.diag(noise.ravel()[known])
    L = np.linalg.cholesky(K)
    half = np.linalg.solve(L, residual.ravel()[known])
    gain = np.linalg.solve(L, own[known])
    variance = np.diag(own) - np.sum(gain**2, axis=0)
    constant = len(known) * np.log(2.0 * np.pi) + 2.0 * np.sum(np.log(np.diag(L)))
    shift = (gain.T @ half).reshape(seen.shape)
    return shift, variance.reshape(seen.shape), float(-0.5 * (half @ half + constant))


def white_deviation(variance: Sequence[float] | np.ndarray, poses: int) -> Deviation:
    """Give a deviation that neither time nor features share: eq. 15 as in the paper."""
    return Deviation(np.diag(np.asarray(variance, float)), np.eye(poses), np.zeros(()))
