"""Where the own unknowns of new recordings are likely, given a draw of a trained model.

They are searched for from many initial values for the draw of highest density; `about_modes`
follows them from there for every other draw.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpyro import handlers

from ..gp.linalg import AnyArray, require_finite
from ..model import Data, HasProgram, Model
from .about_modes import Modes
from .density import ProgramDensity, real_values, sites_of
from .draws import one_by_one
from .optimisation.optimise import Unravel, flattened, maximise, slopes, stack
from .sampling.whitening import SampledDensity, whitening_at

INITIAL = 64
# Modes this much less probable than the best are left out; nearer to each other than this
# many standard deviations they are one.
NEGLIGIBLE, SAME = 20.0, 0.5
# A mode is brought to rounding by so many steps, if it is within so many standard deviations.
NEWTON_STEPS, WITHIN = 3, 0.5


def find_modes(
    model: Model,
    training: tuple,
    new: Data,
    values: dict[str, Array],
    count: int,
    steps: int,
    seed: int,
) -> tuple[Unravel, Modes] | None:
    """Find the modes of the own unknowns for the draw of highest density; None without any."""
    best = best_draw(model, training, values)
    trained = trained_model(model, training[0], {n: v[best] for n, v in values.items()})
    starts = model.initial_values(new, seed, INITIAL, trained)
    data = (*new.data, trained)
    if not own_sites(model, data):
        return None
    density = ProgramDensity(model, jacobian=True)
    first = stack([real_values(density, start, data) for start in starts])
    lanes = min(count, len(starts))
    optimum = maximise(density, first, data, max_steps=steps, keep=count, together=lanes)
    require_finite(optimum.log_density[0], "y")
    unravel = Unravel(jax.tree.map(lambda leaf: leaf[0], first))
    target = SampledDensity(density, unravel)
    at: list[np.ndarray] = []
    factors: list[np.ndarray] = []
    for index, log_density in enumerate(optimum.log_density):
        if not log_density > optimum.log_density[0] - NEGLIGIBLE:
            continue
        here = flattened(jax.tree.map(lambda leaf, i=index: leaf[i], optimum.values))
        here = _polished(target, here, data, lanes)
        factor = _symmetric(whitening_at(target, here, data, together=lanes).factor)
        if all(_apart(here, other, factor) for other in at):
            at.append(here)
            factors.append(factor)
    return unravel, Modes(np.stack(at), np.stack(factors))


def _symmetric(factor: AnyArray) -> Float[np.ndarray, "n n"]:
    """Return the symmetric root of the same covariance.

    Of all roots it alone is a smooth function of it: eigenvectors have any sign.
    """
    vectors, values, _ = np.linalg.svd(np.asarray(factor))
    return (vectors * values) @ vectors.T


def _polished(
    target: SampledDensity, u: Float[np.ndarray, " n"], data: tuple, together: int
) -> Float[np.ndarray, " n"]:
    """Return a mode to rounding, by Newton's steps within its width.

    Where draws are placed about it follows from it: a search that ends elsewhere within its
    tolerance, as in another unit of length, would place them elsewhere.
    """
    factor = np.asarray(whitening_at(target, u, data, together=together).factor)
    for _ in range(NEWTON_STEPS):
        slope = slopes(target.density, target.unravel, u[None], data, together=together)[0]
        step = factor.T @ slope
        if not np.linalg.norm(step) < WITHIN:
            break
        u = u - factor @ step
    return u


def _apart(here: np.ndarray, there: np.ndarray, factor: np.ndarray) -> bool:
    """Whether two modes differ by more than a part of a standard deviation."""
    away = np.linalg.solve(factor, here - there)
    return bool(np.linalg.norm(away) > SAME)


def best_draw(model: Model, data: tuple, values: dict[str, Array]) -> int:
    """Return the draw of highest log density, whatever the order of the draws."""
    if len(next(iter(values.values()))) == 1:
        return 0
    return int(np.argmax(log_densities(model, data, values)))


def log_densities(
    model: HasProgram, data: tuple, values: Mapping[str, AnyArray]
) -> Float[np.ndarray, " s"]:
    """Return the log density of the program at every draw (S, ...) of its sites."""
    return one_by_one(partial(_log_density, model), dict(values), data)


@partial(jax.jit, static_argnames="model")
def _log_density(model: Any, draw: dict[str, Array], data: tuple) -> Float[Array, ""]:
    program = handlers.substitute(model.program, data=draw)
    sites = handlers.trace(program).get_trace(*data).values()
    parts = [jnp.sum(s["fn"].log_prob(s["value"])) for s in sites if s["type"] == "sample"]
    return jnp.sum(jnp.stack(parts))


@partial(jax.jit, static_argnames="model")
def trained_model(model: Any, frames: Any, values: Mapping[str, Array]) -> Any:
    """Return the trained model of one draw (`Model.condition`), as one compiled program."""
    return model.condition(frames, dict(values))


def own_sites(model: Model, data: tuple) -> list[str]:
    """Return the names of the sites that new data have of their own."""
    program = handlers.seed(model.program, jax.random.key(0))
    sites = sites_of(program, data)
    return [n for n, s in sites.items() if s["type"] == "sample" and not s["is_observed"]]
