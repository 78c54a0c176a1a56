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

STARTS, KEEP, STEPS = 2, 1, 40


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


@jax.jit
def _scores(model: PoseModel, given: Measured, white: AnyArray) -> Array:
    density = _PathDensity()
    return jax.lax.map(
        lambda x: density({"x": x}, (model, given, white)), jnp.asarray(model.candidates)
    )


def represent(
    model: PoseModel, given: Measured, white: Float[AnyArray, " d"], max_steps: int = STEPS
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
    """
    given = Measured(*map(jnp.asarray, given))
    best = jnp.argsort(-_scores(model, given, white))[:STARTS]
    starts = {"x": jnp.asarray(model.candidates)[best]}
    data = (model, given, jnp.asarray(white))
    optimum = maximise(_PathDensity(), starts, data, max_steps=max_steps, keep=KEEP, tolerance=1e-6)
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
    above = np.maximum(found.variance - float(deviation.usual), 0.0)
    out = _posterior(jnp.asarray(found.mean), jnp.asarray(above), Measured(*given), deviation)
    mean, sd, log_density = (np.asarray(part) for part in out)
    return Pose(mean, sd, float(log_density))


@jax.jit
def _posterior(mean, variance, given: Measured, deviation: Deviation):
    t, d = mean.shape
    own = jnp.kron(deviation.time, deviation.features)
    own = own + jnp.diag(variance.ravel())
    seen = jnp.asarray(given.seen).ravel()
    # A little noise on what is exact keeps it from being a matter of rounding.
    noise = jnp.asarray(given.noise).ravel() + 1e-8
    K = seen[:, None] * seen[None, :] * (own + jnp.diag(noise)) + jnp.diag(1.0 - seen)
    residual = seen * (jnp.asarray(given.u) - mean).ravel()
    L = jnp.linalg.cholesky(K)
    half = jax.scipy.linalg.solve_triangular(L, residual, lower=True)
    gain = jax.scipy.linalg.solve_triangular(L, seen[:, None] * own, lower=True)
    at = mean.ravel() + gain.T @ half
    left = jnp.maximum(jnp.diagonal(own) - jnp.sum(gain**2, axis=0), 0.0)
    constant = jnp.sum(jnp.log(jnp.diagonal(L))) + 0.5 * jnp.sum(seen) * jnp.log(2.0 * jnp.pi)
    return at.reshape(t, d), jnp.sqrt(left).reshape(t, d), -0.5 * half @ half - constant


def white_deviation(variance: Sequence[float] | np.ndarray, poses: int) -> Deviation:
    """Give a deviation that neither time nor features share: eq. 15 as in the paper."""
    return Deviation(np.diag(np.asarray(variance, float)), np.eye(poses), np.zeros(()))
