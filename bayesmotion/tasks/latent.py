"""The latent path of a cycle that was not trained on: eq. 15 of Ding and Fan.

A new cycle has latent points x_1 .. x_T and poses y_t; what is measured, u_t, may lack
entries and be noisy:

    p(y, x | u) ~ p(u | y) p(y | x) p(x)

    u_td = y_td + noise_td                where entry d of pose t is seen
    y_t  = f(x_t) + d_t                   f: the trained process; d: the subject residual
    p(x)                                  of the trained model (`PoseModel.log_bend`)

x is found by its mode for one draw of the trained model, with d as white noise of the
variance that new people are known to have (`infer_path`); what follows for y is in
`pose_posterior`.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..distributions.topology import Surface
from ..gp.linalg import AnyArray
from ..inference.optimisation.optimise import maximise
from ..model import ProgramData
from ..models.gait_pose.data import Cycles
from ..models.gait_pose.encoding import CycleEncoding

FOLLOWED, KEEP, STEPS, TRIAL_STEPS = 2, 1, 25, 5


@runtime_checkable
class PoseModel(Protocol):
    """A trained model as these tasks see it: a pytree, so that one compilation serves all."""

    @property
    def paths(self) -> Float[AnyArray, "c t q"]:
        """Latent paths of whole cycles, where a search may begin."""
        ...

    def at(self, x: Float[AnyArray, "t q"]) -> tuple[AnyArray, AnyArray]:
        """Return mean and variance (T, D) of the process at latent points."""
        ...

    def log_bend(self, x: Float[AnyArray, "t q"]) -> Float[AnyArray, ""]:
        """Return the log density, up to a constant, of a latent path."""
        ...


@runtime_checkable
class TrainingCycles(ProgramData, Protocol):
    """Training cycles as these tasks see them, in the order (layer, gait, pose)."""

    @property
    def encoding(self) -> CycleEncoding:
        """How poses become features."""
        ...

    @property
    def frames(self) -> Cycles:
        """The features."""
        ...

    @property
    def surface(self) -> Surface | None:
        """The ideal surface of latent points, None for a model without one."""
        ...

    @property
    def poses(self) -> int:
        """Poses of a cycle."""
        ...

    @property
    def scales(self) -> tuple[float, ...]:
        """Of the layers."""
        ...

    @property
    def subjects(self) -> tuple[str, ...]:
        """The person of each cycle."""
        ...

    def complete_cycles(self) -> np.ndarray:
        """Return for every cycle, layer after layer, whether nothing of it is missing."""
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
    """Return what is measured of a cycle; NaN is not seen.

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
class LatentPath:
    """The latent path of a cycle for one draw of the trained model.

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
    """log p(u | x) + log p(x) with white residuals; equal ones share a compilation."""

    def __call__(self, values: dict[str, Any], data: tuple) -> Array:
        model, given, white = data
        x = values["x"]
        mean, variance = model.at(x)
        total = variance + white + given.noise
        each = -0.5 * ((given.u - mean) ** 2 / total + jnp.log(total))
        return jnp.sum(given.seen * each) + model.log_bend(x)


class KnownPaths(NamedTuple):
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
def known_paths(model: PoseModel) -> KnownPaths:
    """Return what a model says at its training cycles' paths, once for all searches."""
    x = jnp.asarray(model.paths)
    mean, variance = jax.lax.map(model.at, x)
    return KnownPaths(x, mean, variance, jax.lax.map(model.log_bend, x))


def _scores(known: KnownPaths, given: Measured, white: np.ndarray) -> np.ndarray:
    """Log density of what is measured at every known path."""
    total = np.asarray(known.variance) + white + given.noise
    off = (given.u - np.asarray(known.mean)) ** 2 / total + np.log(total)
    return -0.5 * np.sum(given.seen * off, axis=(1, 2)) + np.asarray(known.log_prior)


def infer_path(
    model: PoseModel,
    given: Measured,
    white: Float[AnyArray, " d"],
    max_steps: int = STEPS,
    known: KnownPaths | None = None,
) -> LatentPath:
    """Find the latent path of a cycle.

    Parameters
    ----------
    model
        A trained model, one draw of it.
    given
        What is measured of the cycle.
    white
        (D,) variance of what is the person's own in each feature.
    max_steps
        At most so many L-BFGS steps.
    known
        Paths to begin from, where they are at hand.
    """
    known = known_paths(model) if known is None else known
    best = np.argsort(-_scores(known, given, np.asarray(white)))[:FOLLOWED]
    starts = {"x": jnp.asarray(known.x)[best]}
    data = (model, Measured(*map(jnp.asarray, given)), jnp.asarray(white))
    optimum = maximise(
        _PathDensity(),
        starts,
        data,
        max_steps=max_steps,
        keep=KEEP,
        trial_steps=TRIAL_STEPS,
        tolerance=1e-6,
    )
    x = np.asarray(optimum.best()["x"])
    mean, variance = _at(model, x)
    return LatentPath(x, np.asarray(mean), np.asarray(variance), float(optimum.log_density[0]))


@jax.jit
def _at(model: PoseModel, x: AnyArray) -> tuple[AnyArray, AnyArray]:
    return model.at(x)
