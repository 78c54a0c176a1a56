"""Expectation maximisation of voice puppetry, up the log density of its program.

Expectations are derivatives: those of log p(y) by the logarithms of pi and A are the expected
first states and transitions. Entries that are missing stand at their mean given the state and
what is seen, with their covariance added. Then each site in turn goes to its mode given the
others: probabilities by the entropic M-step, means, and precisions.
"""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import PointEstimate, Progress
from ...search_state import SearchState
from ..clusters import find_clusters, nearest_centre
from .data import Frames, PuppetryData
from .entropic import entropic
from .hidden_markov import Chain, fill, log_likelihood, recursions
from .priors import MEAN_SD, STRENGTH, site_priors

if TYPE_CHECKING:
    from .program import VoicePuppetry

BEGIN_STEPS = 5
HEIGHT = "log_density_before"
FLOOR = 1e-3  # share of even probabilities in what a search begins at


class Expected(NamedTuple):
    """Expected first states (K,) and transitions (K, K), states (N, K), and log p(y)."""

    first: Float[Array, " k"]
    moves: Float[Array, "k k"]
    states: Float[Array, "n k"]
    log_likelihood: Float[Array, ""]


def climb(
    model: "VoicePuppetry", data: PuppetryData, seed: int, max_steps: int, tolerance: float,
    progress: Progress | None = None, state: SearchState | None = None,
) -> PointEstimate:  # fmt: skip
    """Return the chain that EM finds, from clusters of frames on.

    It ends when a step gains less than `tolerance` of the log density.
    """
    frames = data.frames
    state = state or SearchState()
    begun, limit = state.steps(max_steps)
    values, height, converged = _from_clusters(model, data, seed), -np.inf, False
    if state.saved is not None:
        values = {name: jnp.asarray(state.saved[name]) for name in values}
        height = float(state.saved[HEIGHT])
    step = begun
    for step in range(begun, limit + 1):
        expected = expect(model, frames, values)
        here = float(expected.log_likelihood) + float(_log_prior(model, frames, values))
        if progress is not None:
            progress(step, here)
        converged = here - height < tolerance * abs(here)
        height = here
        if converged or step == limit:
            break
        values = maximise(model, frames, values, expected)
        state.keep(step + 1, limit, partial(dict, values, **{HEIGHT: here}))
    found = {name: np.asarray(value) for name, value in values.items()}
    return PointEstimate(found, height, step, converged)


def begun(model: "VoicePuppetry", data: PuppetryData, seed: int) -> dict[str, np.ndarray]:
    """Return what a few steps make of clusters, no probability zero."""
    values = dict(climb(model, data, seed, BEGIN_STEPS, 0.0).values)
    for name in ("initial", "transition"):
        values[name] = (1.0 - FLOOR) * np.asarray(values[name]) + FLOOR / model.states
    return {name: np.asarray(value) for name, value in values.items()}


@partial(jax.jit, static_argnames="model")
def expect(model: "VoicePuppetry", frames: Frames, values: Mapping[str, AnyArray]) -> Expected:
    """Return what is expected of the states."""
    states, emission = model.chain(values, frames), model.emissions(values, frames)

    def height(initial: Array, transition: Array) -> Array:
        return log_likelihood(Chain(initial, transition, states.begins), emission)

    log_likely, (first, moves) = jax.value_and_grad(height, (0, 1))(
        states.initial, states.transition
    )
    occupied = jnp.exp(recursions(states, emission).posterior)
    return Expected(first, moves, occupied, log_likely)


def maximise(
    model: "VoicePuppetry", frames: Frames, values: Mapping[str, AnyArray], expected: Expected
) -> dict[str, AnyArray]:
    """Return site values at their modes given what is expected of the states."""
    first, moves = np.asarray(expected.first), np.asarray(expected.moves)
    found: dict[str, AnyArray] = {
        "initial": entropic(first[None])[0], "transition": entropic(moves)
    }  # fmt: skip
    # No more than it needs, so that its first call, which knows no moves, compiles it for all.
    outputs = {n: v for n, v in values.items() if n.endswith(("_mean", "_precision"))}
    return found | _normals(model, frames, outputs, expected.states)


@partial(jax.jit, static_argnames="model")
def _normals(
    model: "VoicePuppetry", frames: Frames, values: Any, states: Float[AnyArray, "n k"]
) -> dict[str, Array]:
    """Return means, and with them precisions, of all outputs."""
    found, n = {}, jnp.sum(states, axis=0)
    for name in model.outputs:
        y, rows = frames.y[name], frames.rows[name]
        precision = jnp.asarray(values[f"{name}_precision"])
        filled, missing = fill(values[f"{name}_mean"], precision, y, rows)
        total = jnp.einsum("nk,nkd->kd", states, filled)
        ridge = jnp.eye(y.shape[1]) / MEAN_SD**2
        pulled = jnp.einsum("kde,ke->kd", precision, total)
        mean = jnp.linalg.solve(n[:, None, None] * precision + ridge, pulled[..., None])[..., 0]
        away = filled - mean
        scatter = jnp.einsum("nk,nkd,nke->kde", states, away, away)
        ofpattern = jnp.zeros((rows.seen.shape[0], len(n))).at[rows.which].add(states)
        scatter = scatter + jnp.einsum("pk,pkde->kde", ofpattern, missing)
        scatter = scatter + STRENGTH * model.state_sd**2 * jnp.eye(y.shape[1])
        found[f"{name}_mean"] = mean
        found[f"{name}_precision"] = (n + STRENGTH)[:, None, None] * jnp.linalg.inv(scatter)
    return found


@partial(jax.jit, static_argnames="model")
def _log_prior(
    model: "VoicePuppetry", frames: Frames, values: Mapping[str, AnyArray]
) -> Float[Array, ""]:
    priors = site_priors(model, frames)
    return sum((jnp.sum(priors[name].log_prob(values[name])) for name in priors), jnp.zeros(()))


def _from_clusters(model: "VoicePuppetry", data: PuppetryData, seed: int) -> dict[str, AnyArray]:
    """Return the chain whose states are clusters of frames, missing entries at their mean."""
    frames, k = data.frames, model.states
    every = np.concatenate([np.nan_to_num(np.asarray(frames.y[n])) for n in model.outputs], axis=1)
    if k > len(every):
        raise InputError("states", f"there are {k} for {len(every)} frames", "Use fewer")
    nearest = nearest_centre(every, find_clusters(every, k, seed=seed).centre)
    states = np.eye(k)[nearest]
    begins = np.asarray(frames.begins)
    first = states[begins].sum(axis=0) + 0.1
    moves = np.where(begins[1:, None], 0.0, states[:-1]).T @ states[1:] + 0.1
    values: dict[str, AnyArray] = {}
    for name in model.outputs:
        d = frames.y[name].shape[1]
        values[f"{name}_mean"] = np.zeros((k, d))
        values[f"{name}_precision"] = np.repeat(np.eye(d)[None], k, axis=0)
    expected = Expected(*map(jnp.asarray, (first, moves, states, 0.0)))
    for _ in range(2):  # means come with the precisions of the step before
        values = maximise(model, frames, values, expected)
    return values
