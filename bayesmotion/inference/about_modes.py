"""What one draw of a trained model says of new data: at modes of its unknowns, and about them.

Modes are followed from where they were found for another draw of the model, and the unknowns are
drawn about them by sampling and importance resampling (`predicting` says how).
"""

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from .density import ProgramDensity
from .optimisation.descent import descend
from .optimisation.optimise import Unravel

FOLLOW_STEPS = 60
# Draws about a mode of which one is chosen by its importance.
CANDIDATES = 8


class Counts(NamedTuple):
    """How many of what is drawn for a draw of the fit and a mode.

    unknowns
        Draws of the unknowns about the mode; none for the mode itself.
    mixtures
        Of the marginals at each of these.
    samples
        Joint draws at each of these.
    """

    unknowns: int
    mixtures: int
    samples: int


class Modes(NamedTuple):
    """Where the search for a recording's own unknowns begins for every draw.

    at
        (M, m) numbers on the real line.
    factor
        (M, m, m) roots of their covariance there.
    """

    at: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k m m"]


class Told(NamedTuple):
    """What is said of new data at the unknowns of modes (K, ...), L of each.

    entries
        Marginals (K, L, J, N, D) at the mode, and then at every draw about it.
    samples
        Joint draws (K, L, J, N, D), at the mode or at every draw about it.
    unknowns
        Values of the unknowns at the mode, and then of every draw about it.
    log_mass
        (K,) about the mode.
    """

    entries: dict[str, Any]
    samples: dict[str, Array]
    unknowns: dict[str, Array]
    log_mass: Array


@partial(jax.jit, static_argnames=("model", "unravel", "counts"))
def predict_one(
    model: Any,
    unravel: Unravel | None,
    counts: Counts,
    trained: Any,
    key: Key[Array, ""],
    seen: tuple,
    new: tuple,
    modes: Modes | None,
) -> Told:
    """Return what a draw and all modes say; what is seen tells the unknowns of what is new."""
    density = ProgramDensity(model, jacobian=True)
    data = (*seen, trained)

    def said(own: Mapping[str, Array], key: Array) -> tuple[dict[str, Any], dict[str, Array]]:
        predicted = model.predict(trained, *new, own)
        mixing, drawing = jax.random.split(key)
        mixed = jax.random.split(mixing, counts.mixtures)
        entries = {name: jax.vmap(each.marginals)(mixed) for name, each in predicted.items()}
        keys = _first_and_more(drawing, counts.samples)
        return entries, {name: jax.vmap(each.sample)(keys) for name, each in predicted.items()}

    if modes is None or unravel is None:
        entries, samples = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None, None], said({}, key))
        return Told(entries, samples, {}, density({}, data)[None])
    transform: Unravel = unravel

    def follow(mode: tuple) -> Told:
        at, factor, key = mode

        def loss(z: Array) -> Array:
            return -density(transform(at + factor @ z), data)

        def told(z: Array, key: Array) -> tuple[dict, dict, dict]:
            own = density.natural(transform(at + factor @ z), data)
            entries, samples = said(own, key)
            return entries, samples, dict(own)

        found = descend(loss, jnp.zeros(factor.shape[1]), evaluations=FOLLOW_STEPS)
        log_mass = jnp.linalg.slogdet(factor)[1] - found.value
        z, keys = jnp.zeros((1, factor.shape[1])), key[None]
        if counts.unknowns:
            placing, choosing, drawing = jax.random.split(jax.random.fold_in(key, 1), 3)
            all_z = jax.random.normal(placing, (CANDIDATES * counts.unknowns, factor.shape[1]))
            away = 0.5 * jnp.sum(all_z**2, axis=1)
            away = away - jax.lax.map(lambda z: loss(found.x + z), all_z)
            chosen = all_z[_by_importance(choosing, away, counts.unknowns)]
            z = jnp.concatenate([z, chosen])
            keys = jnp.concatenate([keys, jax.random.split(drawing, counts.unknowns)])
        # The mode and draws about it by one program: compiling takes longer than running it.
        entries, samples, own = jax.lax.map(lambda one: told(found.x + one[0], one[1]), (z, keys))
        first = min(counts.unknowns, 1)
        return Told(entries, {n: each[first:] for n, each in samples.items()}, own, log_mass)

    keys = jax.random.split(key, modes.at.shape[0])
    return jax.lax.map(follow, (jnp.asarray(modes.at), jnp.asarray(modes.factor), keys))


def _by_importance(key: Key[Array, ""], away: Float[Array, " c"], count: int) -> Int[Array, " l"]:
    """Return which candidates are chosen: systematic resampling by weights that are cut off.

    `away` is the log density at each less that of the normal it was drawn from, up to a
    constant; candidates without a density are not chosen.
    """
    away = jnp.where(jnp.isfinite(away), away, -jnp.inf)
    weight = jnp.exp(away - jnp.max(away))
    weight = jnp.minimum(weight, jnp.sqrt(len(away)) * jnp.mean(weight))
    edges = jnp.cumsum(weight) / jnp.sum(weight)
    places = (jnp.arange(count) + jax.random.uniform(key)) / count
    return jnp.minimum(jnp.searchsorted(edges, places), len(away) - 1)


def _first_and_more(key: Key[Array, ""], count: int) -> Key[Array, " n"]:
    """Return so many keys, the first of which is the same however many there are."""
    more = jax.vmap(lambda index: jax.random.fold_in(key, index))(jnp.arange(1, count))
    return jnp.concatenate([key[None], more])
