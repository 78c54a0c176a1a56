"""What samplers share: what they move on, where they begin, how draws become values.

A sampler moves on numbers z (n,), related to the sites' values u on the real line by

    u = mode + L z,    L L^T = H^-1,

H the negative Hessian of the log density at its mode: near the mode z is about
standard normal, whatever the units of the sites and however sharp the posterior. Of
hundreds of unknowns the mode is far from where the draws are, and with ``start="typical"``
H is the mean over points there (`typical_set`). The log density is that of the model with
what it can integrate out integrated out (`model.Marginalised`); for every draw that is drawn
again, exactly. Rotations that no data can tell are left out of z (`rotations`).
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from numpyro import handlers

from ...errors import InputError
from ...gp.linalg import AnyArray, require_finite
from ...model import Fittable, Marginalised, ProgramData, RotationInvariant
from ..densities import require_densities
from ..density import ProgramDensity, RealDensity, real_values
from ..draws import in_blocks, on_device, one_by_one
from ..optimisation.mode import begin, climb
from ..optimisation.optimise import Optimum, Unravel, flattened, maximise, slopes
from .rotations import log_orbit_volume, orthogonal_complement, rotation_directions

Start = Literal["map", "typical", "prior"]

# No direction is taken for wider than two units: the priors are hardly wider, and where
# the posterior is flat at the mode (a rotation left free) its Hessian says nothing.
LEAST_CURVATURE = 0.25
# Steps of differences: the first, of unknowns of any size, and then in units of their widths.
FIRST, STEP = 1e-5, 3e-3
# Draws that are worked on together.
BLOCK = 8
HALVINGS = 20
MODE_STARTS, MODE_STEPS = 4, 1000
ROUNDS, ROUND_STEPS = 4, 300


@dataclass(frozen=True)
class SampledDensity:
    """The log density a sampler sees, a function of z; equal targets share a compilation.

    density
        Log density on the real line, or in other coordinates that are free of bounds.
    unravel
        Gives the sites' values back from u.
    rotations
        Sites (N, Q) that z holds turned towards the place's mode.
    """

    density: RealDensity
    unravel: Unravel
    rotations: tuple[str, ...] = ()

    def __call__(self, z: Float[AnyArray, " m"], transform: "Whitening", data: tuple) -> Array:
        """Evaluate; NaN where a covariance matrix cannot be factorised."""
        values = self.unravel(jnp.asarray(transform.mode + transform.factor @ z))
        density = self.density(values, data)
        if not self.rotations:
            return density
        at = self.unravel(jnp.asarray(transform.mode))
        return density + sum(log_orbit_volume(values[name], at[name]) for name in self.rotations)


class Whitening(NamedTuple):
    """The map from z (m,) to u (n,): mode (n,) and factor L (n, m).

    m is n less the dimensions of the rotations that `SampledDensity.rotations` leaves out.
    """

    mode: Float[AnyArray, " n"]
    factor: Float[AnyArray, "n m"]


@dataclass(frozen=True)
class SamplingProblem:
    """A model with its training data, ready to be sampled.

    converged
        Whether the search for the mode ended by itself; true where there was none.
    """

    model: Fittable
    training: ProgramData
    target: SampledDensity
    transform: Whitening
    converged: bool

    @property
    def unknowns(self) -> int:
        """The number m of unknowns that are sampled."""
        return self.transform.factor.shape[1]

    def arrays(self) -> dict[str, np.ndarray]:
        """Give what `sampling_problem` finds, so that it need not be found again."""
        found = {
            "mode": np.asarray(self.transform.mode),
            "factor": np.asarray(self.transform.factor),
        }
        return {**found, "mode_converged": np.array(self.converged)}

    def log_density(self, z: AnyArray) -> Array:
        """Log densities (s,) at points z (s, m)."""
        return _log_densities(self.target, jnp.asarray(z), self.transform, self.training.data)

    def values(self, key: PRNGKeyArray, z: Float[AnyArray, "c d m"]) -> dict[str, np.ndarray]:
        """Give all sites' values (chain, draw, ...), those integrated out drawn again."""
        flat = np.asarray(z).reshape(-1, self.unknowns)
        keys = jax.random.split(key, len(flat))
        values = partial(_values, self.model, self.target)
        found = one_by_one(values, (keys, flat), self.transform, self.training.data)
        return {
            name: value.reshape(*z.shape[:2], *value.shape[1:]) for name, value in found.items()
        }


def stage_key(seed: int, stage: str) -> PRNGKeyArray:
    """Give the random key of a stage of a run: one seed, split by name."""
    return jax.random.fold_in(jax.random.PRNGKey(seed), zlib.crc32(stage.encode()))


def sampling_problem(
    model: Fittable,
    training: ProgramData,
    seed: int,
    start: Start,
    integrate: bool = True,
    found: Mapping[str, np.ndarray] | None = None,
) -> SamplingProblem:
    """Find the mode and the Hessian there; with ``start="prior"`` z is u itself.

    Where sites turn, what is climbed last is the density times the volume of their orbits,
    which is the one that is sampled.

    integrate
        Whether what the model can integrate out is integrated out.
    found
        Where they have been found before (`SamplingProblem.arrays`) they are taken as they are.

    Raises
    ------
    InputError
        If a prior is improper, a part of the density is none (`densities`), or there is no
        such start.
    NumericalError
        If no start has a finite log density.
    """
    if start not in get_args(Start):
        known = ", ".join(get_args(Start))
        raise InputError(f"start {start!r}", "there is no such start", f"Use one of {known}")
    program = "collapsed" if integrate and isinstance(model, Marginalised) else "program"
    density, data = ProgramDensity(model, program, jacobian=True), training.data
    values = model.initial_values(training, seed, 1)[0]
    at = on_device(values)
    require_densities(handlers.substitute(getattr(model, program), data=at), data)
    real = real_values(density, values, data)
    # About zero there is nothing to turn towards.
    rotations = model.rotations if isinstance(model, RotationInvariant) and start != "prior" else ()
    target = SampledDensity(density, Unravel(real), rotations)
    if found is not None:
        transform = Whitening(found["mode"], found["factor"])
        return SamplingProblem(model, training, target, transform, bool(found["mode_converged"]))
    if start == "prior":
        n = len(flattened(real))
        return SamplingProblem(model, training, target, Whitening(np.zeros(n), np.eye(n)), True)
    starts = begin(model, training, seed=seed, starts=MODE_STARTS, max_steps=MODE_STEPS)
    optimum = climb(density, training, starts, keep=1, max_steps=MODE_STEPS)
    transform, converged = _at_the_mode(target, optimum, data)
    return SamplingProblem(model, training, target, transform, converged)


def whitening_at(
    target: SampledDensity, mode: Float[np.ndarray, " n"], data: tuple, *, together: int = 1
) -> Whitening:
    """Give the map around a mode that makes the Hessian there one; arguments as `hessian_at`."""
    return transform_at(target, mode, hessian_at(target, mode, data, together=together))


def hessian_at(
    target: SampledDensity, u: Float[np.ndarray, " n"], data: tuple, *, together: int = 1
) -> Float[np.ndarray, "n n"]:
    """Negative Hessian of the log density in u, by central differences of exact gradients.

    The search for the mode has compiled the gradient; second derivatives would be another
    program, the largest of all. Steps are a small part of the width that the curvature along
    each unknown leaves it, so that what the differences neglect is of the order of `STEP` squared.

    Parameters
    ----------
    target, data
        The density and its arguments.
    u
        Where.
    together
        Gradients that are computed by one call, as in the search.

    Raises
    ------
    InputError
        If a gradient takes more memory than is free.
    NumericalError
        If it is not finite.
    """
    unit = np.eye(len(u))

    def at(steps: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "k n"]:
        return slopes(target.density, target.unravel, u + steps, data, together=together)

    first = FIRST * np.maximum(np.abs(u), 1.0)
    curvature = np.diagonal(at(first[:, None] * unit) - at(np.zeros((1, len(u))))) / first
    require_finite(curvature, "y")
    step = STEP / np.sqrt(np.maximum(np.abs(curvature), LEAST_CURVATURE))
    hessian = (at(step[:, None] * unit) - at(-step[:, None] * unit)) / (2.0 * step[:, None])
    require_finite(hessian, "y")
    return 0.5 * (hessian + hessian.T)


def transform_at(
    target: SampledDensity, mode: Float[np.ndarray, " n"], hessian: Float[np.ndarray, "n n"]
) -> Whitening:
    """Give the map around a point that makes this Hessian one, less what turns there."""
    free = orthogonal_complement(
        rotation_directions(target.unravel(np.asarray(mode)), target.rotations)
    )
    return Whitening(mode, free @ whitening(free.T @ hessian @ free))


@dataclass(frozen=True)
class _Whitened:
    """The target as a function that `maximise` climbs: of {"z": z} and (place, data)."""

    target: SampledDensity

    def __call__(self, values: Mapping[str, Array], given: tuple) -> Array:
        transform, data = given
        return self.target(values["z"], transform, data)


def _at_the_mode(target: SampledDensity, optimum: Optimum, data: tuple) -> tuple[Whitening, bool]:
    """Find the map that makes the Hessian at the mode one; say whether the search converged.

    A search that gave up goes on in the whitened unknowns, where no direction is
    steeper than another, as long as that helps.
    """
    mode, converged = flattened(optimum.best()), bool(optimum.converged[0])
    transform = whitening_at(target, mode, data)
    for _ in range(ROUNDS):
        if converged:
            break
        still = {"z": np.zeros((1, transform.factor.shape[1]))}
        found = maximise(_Whitened(target), still, (transform, data), max_steps=ROUND_STEPS)
        mode = transform.mode + transform.factor @ found.best()["z"]
        converged = bool(found.converged[0])
        transform = whitening_at(target, mode, data)
    return transform, converged


def whitening(hessian: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """Give L with L L^T = H^-1, H with the absolute values of its eigenvalues, none too small."""
    curvature, directions = np.linalg.eigh(0.5 * (hessian + hessian.T))
    return directions / np.sqrt(np.maximum(np.abs(curvature), LEAST_CURVATURE))


def chain_starts(
    problem: SamplingProblem, key: PRNGKeyArray, count: int, start: Start
) -> np.ndarray:
    """Give points z (count, m) to begin at, of finite log density.

    About the mode they are draws of its Gaussian approximation, drawn in towards the
    mode where the density has no value; else they are draws of the prior.
    """
    if start == "prior":
        return _prior_draws(problem, key, count)
    z = np.asarray(jax.random.normal(key, (count, problem.unknowns)))
    for _ in range(HALVINGS):
        bad = ~np.isfinite(np.asarray(problem.log_density(z)))
        if not bad.any():
            return z
        z = np.where(bad[:, None], 0.5 * z, z)
    require_finite(np.asarray(problem.log_density(z)), "y")
    return z


def _prior_draws(problem: SamplingProblem, key: PRNGKeyArray, count: int) -> np.ndarray:
    density, data = problem.target.density, problem.training.data
    found = []
    for index in range(count * HALVINGS):
        drawn = _drawn(problem.model, density.program, jax.random.fold_in(key, index), data)
        z = flattened(real_values(density, drawn, data))
        if np.isfinite(np.asarray(problem.log_density(z[None]))[0]):
            found.append(z)
        if len(found) == count:
            return np.stack(found)
    require_finite(np.nan, "prior")
    raise AssertionError


@partial(jax.jit, static_argnames=("model", "program"))
def _drawn(model, program, key, data):
    """Draw the sites of a program."""
    sites = handlers.trace(handlers.seed(getattr(model, program), key)).get_trace(*data)
    return {n: s["value"] for n, s in sites.items() if s["type"] == "sample"}


@partial(jax.jit, static_argnames="target")
def _log_densities(target, z, transform, data):
    return in_blocks(lambda one: target(one, transform, data), z, BLOCK)


@partial(jax.jit, static_argnames=("model", "target"))
def _values(model, target, key_and_point, transform, data):
    key, point = key_and_point
    real = target.unravel(transform.mode + transform.factor @ point)
    values = target.density.natural(real, data)
    if target.density.program == "collapsed":
        values = model.complete_draw(key, *data, values)
    return {name: jnp.asarray(value) for name, value in values.items()}
