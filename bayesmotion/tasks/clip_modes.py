"""The modes of a new clip's own unknowns, given a trained model, and what each is worth.

The search climbs from many starts and keeps the best it finds. Frames of a slow walk may be
those of a fast one, seen for a short time; so the forecast is the mixture of all modes,
weighed by the posterior mass about each (Laplace's approximation, MacKay 2003, ch. 27):

    log mass = log p(u) + log |d natural / du| - 1/2 log det H,    H = -d2 log p / du2,

p the density of the sites in their own units, and u their coordinates without bounds. Where
p is flat, H is taken for no less than `inference.sampling.LEAST_CURVATURE`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float
from scipy.special import logsumexp

from ..fit import Fit
from ..gp.linalg import AnyArray
from ..inference.density import ProgramDensity
from ..inference.mode import stack
from ..inference.optimise import Optimum, Unravel, maximise
from ..inference.sampling import Target, whitened
from ..models.multifactor import Multifactor
from ..models.new_clips import extend, new_clip_starts
from ..models.poses import Frames
from ..models.predicting import Given, Prediction
from ..models.starts import search_roots
from ..prediction import Mixture

# As many of the starts are followed to the end.
KEEP = 8
# Modes that predict the same are one: the largest difference, of a feature's spread in training.
ALIKE = 0.05


@dataclass(frozen=True)
class Modes:
    """The modes found of a new clip's unknowns, the highest density first.

    values
        The sites of each.
    log_mass
        (M,) logarithm of the posterior mass about each, up to a constant.
    """

    values: list[dict[str, np.ndarray]]
    log_mass: Float[np.ndarray, " m"]


def unstrayed(model: Multifactor) -> Multifactor:
    """Give the model that a new clip's unknowns are estimated by (`Multifactor.freedom`).

    It is the same for all degrees of freedom, so that they share a compilation.
    """
    return replace(model, freedom=None)


def search(fit: Fit, frames: Frames, *, max_steps: int = 400) -> Optimum:
    """Climb the density of a new clip's own sites from many starts."""
    density = ProgramDensity(unstrayed(fit.model))
    starts = new_clip_starts(fit.model, frames, fit.training.frames, fit.values(), fit.trained)
    first = stack([density.real(start, (frames, fit.trained)) for start in starts])
    roots = search_roots(fit.model, frames, starts[0], fit.trained)
    data = (frames, fit.trained)
    return maximise(
        density, first, data, max_steps=max_steps, keep=KEEP, roots=roots, together=KEEP
    )


def modes_of(fit: Fit, frames: Frames, optimum: Optimum) -> Modes:
    """Weigh what a search found: the best, and all others that converged."""
    model, data = unstrayed(fit.model), (frames, fit.trained)
    density = ProgramDensity(model)
    found = np.flatnonzero(optimum.converged & np.isfinite(optimum.log_density))
    values, masses = [], []
    for lane in sorted({0, *found.tolist()}):
        at = {name: jnp.asarray(value[lane]) for name, value in optimum.values.items()}
        masses.append(log_mass(model, at, data))
        natural = density.natural(at, data)
        values.append({name: np.asarray(value) for name, value in natural.items()})
    return Modes(values, np.array(masses))


def log_mass(model: Any, at: Mapping[str, AnyArray], data: tuple) -> float:
    """Give the logarithm of the posterior mass about a mode, up to (n / 2) log 2 pi.

    Parameters
    ----------
    model
        A model with a ``program``.
    at
        The sites' coordinates without bounds, at a mode of the density in their own units.
    data
        The arguments of the program.
    """
    u = np.asarray(ravel_pytree(dict(at))[0])
    place = whitened(Target(ProgramDensity(model), Unravel(dict(at))), u, data)
    height = _log_density(ProgramDensity(model, jacobian=True), dict(at), data)
    return float(height) + float(np.linalg.slogdet(place.factor)[1])


def predict(fit: Fit, whole: Frames, modes: Modes) -> tuple[Modes, Mixture]:
    """Predict a clip's features, in their own units, by each mode; of modes alike take one.

    Parameters
    ----------
    fit
        The fit.
    whole
        The clip's frames, those to come too.
    modes
        What was found for the frames given.
    """
    encoding = fit.training.encoding
    means, sds, kept = [], [], []
    for index, values in enumerate(modes.values):
        going_on = extend(fit.model, values, fit.trained, len(np.asarray(whole.clip)))
        predicted = _predict(fit.model, whole, going_on, fit.trained)
        mean, sd = np.asarray(predicted.mean), np.sqrt(np.asarray(predicted.variance()))
        if all(np.max(np.abs(mean - other)) > ALIKE for other in means):
            means.append(mean)
            sds.append(sd)
            kept.append(index)
    log_mass = modes.log_mass[kept]
    weight = np.exp(log_mass - logsumexp(log_mass))
    mixture = Mixture(encoding.unscaled(np.stack(means)), np.stack(sds) * encoding.spread, weight)
    return Modes([modes.values[index] for index in kept], log_mass), mixture


@partial(jax.jit, static_argnames="density")
def _log_density(density: ProgramDensity, real: dict, data: tuple) -> jax.Array:
    return density(real, data)


@partial(jax.jit, static_argnames="model")
def _predict(model: Multifactor, frames: Frames, values: dict, given: Given) -> Prediction:
    return model.predict(frames, values, given)
