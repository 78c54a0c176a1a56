"""Where the search for the mode of a shared latent model begins.

Training with a back-constraint: latent points are what ridge regression makes of the other
views from what the map sees, principal components of the prediction, each of unit size, for
they are what views have in common; if there are fewer than wanted, the main components of
what the map sees go on. Without one they are principal components of all views together,
missing entries at their mean.

New clips: start A is the back-constraint, start B Viterbi's path through training points,
with p(y*_t | x) for emissions and the dynamics for transitions (Deena and Galata 2009, 4.2).
"""

from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ...distributions.dynamics import kernel
from ...gp.linalg import AnyArray
from ...gp.sparse import SparsePosterior
from .back_constraint import Identity
from .data import SharedData, Views, evenly
from .processes import Trained, frame_moments, pattern_of_columns, view_points

if TYPE_CHECKING:
    from .program import SharedGPLVM

RIDGE = 0.03  # of the mean square of what is seen, in every direction
STATES = 1000  # of the hidden Markov model, at most
NEAR = 0.3  # standard deviation of what further starts are away from the first ones
NEW = 4  # starts of new clips, at most


def of_training(
    model: "SharedGPLVM", data: SharedData, seed: int, count: int
) -> list[dict[str, np.ndarray]]:
    """Return `count` starts; the first has the latent points of the module as they are."""
    frames, sizes = data.frames, model.private_sizes()
    wanted = model.latent_size + (0 if model.back is None else sizes[model.back.view])
    x = _latent(model, frames, wanted)
    found = []
    for number in range(count):
        random = np.random.default_rng([seed, number])
        near = x + (NEAR if number else 0.0) * random.normal(size=x.shape)
        values = _hyperparameters(model)
        if model.back is None:
            values["x"] = near
        else:
            inputs = np.asarray(frames.inputs)[frames.kept]
            values |= model.back.weights_near(inputs, near, np.asarray(frames.centres), random)
        mapped = None if model.back is None else model.back.view
        for name, size in sizes.items():
            if size and name != mapped:
                values[f"{name}_private"] = random.normal(size=(len(x), size))
        found.append(values)
    return found


def of_new_clips(
    model: "SharedGPLVM", data: SharedData, seed: int, count: int, trained: Trained
) -> list[dict[str, np.ndarray]]:
    """Return at most `count` starts of the path of new clips: A, B, and some near B."""
    frames = data.frames
    mapped = None if model.back is None else model.back.view
    free = {f"{name}_private": size for name, size in model.private_sizes().items()
            if size and name != mapped}  # fmt: skip
    paths: list[dict[str, np.ndarray]] = [{}]
    if model.back is None or not isinstance(model.back.map, Identity):
        paths = []
        if model.back is not None:
            made = model.mapped(frames.inputs, trained.centres, trained.values)[0]
            paths.append({"x": np.asarray(made)})
        rows = likeliest_rows(model, frames, trained)
        paths.append({"x": np.asarray(trained.values["x"])[rows]})
        while len(paths) < NEW and model.back is None:
            random = np.random.default_rng([seed, len(paths)])
            first = paths[0]["x"]
            paths.append({"x": first + NEAR * random.normal(size=first.shape)})
    random = np.random.default_rng(seed)
    n = len(frames.kept)
    own = {name: 0.1 * random.normal(size=(n, size)) for name, size in free.items()}
    return [{**path, **own} for path in paths[:count]]


def likeliest_rows(model: "SharedGPLVM", frames: Views, trained: Trained) -> Int[np.ndarray, " t"]:
    """Return the training frames that are the likeliest path of new clips."""
    rows = evenly(len(trained.values["x"]), STATES)
    emission, transition = _hidden_markov(model, frames, trained, jnp.asarray(rows))
    emission, transition = np.asarray(emission), np.asarray(transition)
    bounds = np.flatnonzero(np.diff(np.asarray(frames.clip))) + 1
    parts = [likeliest_path(part, transition) for part in np.split(emission, bounds)]
    return rows[np.concatenate(parts)]


def likeliest_path(
    emission: Float[np.ndarray, "t s"], transition: Float[np.ndarray, "s s"]
) -> Int[np.ndarray, " t"]:
    """Return Viterbi's path: log emissions, log transitions from row to column."""
    best, back = emission[0], np.zeros(emission.shape, int)
    for t in range(1, len(emission)):
        every = best[:, None] + transition
        back[t] = np.argmax(every, axis=0)
        best = every[back[t], np.arange(every.shape[1])] + emission[t]
    path = np.empty(len(emission), int)
    path[-1] = int(np.argmax(best))
    for t in range(len(emission) - 1, 0, -1):
        path[t - 1] = back[t, path[t]]
    return path


def _hidden_markov(
    model: "SharedGPLVM", frames: Views, trained: Trained, rows: AnyArray
) -> tuple[AnyArray, AnyArray]:
    """Return log emissions (T, S) of all seen entries and log transitions (S, S)."""
    x = jnp.asarray(trained.values["x"])[rows]
    emission = jnp.zeros((len(frames.kept), len(rows)))
    for name in model.views:
        own = trained.values.get(f"{name}_private")
        private = {} if own is None else {name: jnp.asarray(own)[rows]}
        points = view_points(name, trained.values, x, private)
        mean, variance = frame_moments(trained.views[name], points)
        missing, y = frames.missing[name], jnp.asarray(frames.y[name])
        own_variance = variance[pattern_of_columns(missing)]  # (D, S)
        noisy = own_variance + 1.0 / trained.values[f"{name}_beta"]

        def each(row: AnyArray, mean=mean, noisy=noisy) -> AnyArray:
            said = -0.5 * ((row - mean) ** 2 / noisy.T + jnp.log(2.0 * jnp.pi * noisy.T))
            return jnp.sum(jnp.where(jnp.isnan(row), 0.0, said), axis=1)

        emission = emission + jax.lax.map(each, y)
    if model.dynamics is None or trained.steps is None:
        return emission, jnp.zeros((len(rows), len(rows)))
    unit = (x - trained.mean) / trained.scale
    mean, variance = _steps_from(model, trained, unit)
    squares = jnp.sum(mean**2, axis=1)[:, None] + jnp.sum(unit**2, axis=1) - 2.0 * mean @ unit.T
    each_step = squares / variance[:, None]
    return emission, -0.5 * (each_step + unit.shape[1] * jnp.log(variance)[:, None])


def _steps_from(
    model: "SharedGPLVM", trained: Trained, unit: AnyArray
) -> tuple[AnyArray, AnyArray]:
    """Return mean (S, Q) and variance (S,) of what follows points of unit scale."""
    assert model.dynamics is not None
    steps, noise = trained.steps, model.dynamics.noise_sd**2
    if isinstance(steps, SparsePosterior):
        mean, variance = steps({"x": unit})
        return mean, variance[0] + noise
    assert steps is not None
    alpha_kernel = kernel(model.dynamics.hyperparameters(trained.values["alpha"]))
    cross, own = (alpha_kernel.matrix({"x": unit}, at) for at in (steps.states, {"x": unit}))
    mean, covariance = steps.conditioned(cross, own)
    return mean, jnp.diagonal(covariance[0]) + noise


def _latent(model: "SharedGPLVM", frames: Views, wanted: int) -> Float[np.ndarray, "n q"]:
    """Return latent points to begin from, each coordinate of unit size."""
    kept = np.asarray(frames.kept)
    views = {name: np.nan_to_num(np.asarray(y)[kept]) for name, y in frames.y.items()}
    if model.back is None:
        return _components(np.concatenate(list(views.values()), axis=1), wanted)
    seen = np.asarray(frames.inputs)[kept]
    others = np.concatenate([y for name, y in views.items() if name != model.back.view], axis=1)
    gram = seen.T @ seen + RIDGE * len(seen) * np.mean(seen**2) * np.eye(seen.shape[1])
    told = seen @ np.linalg.solve(gram, seen.T @ others)
    common = _components(told, min(wanted, others.shape[1], seen.shape[1]))
    if common.shape[1] == wanted:
        return common
    rest = seen - common @ np.linalg.lstsq(common, seen)[0]
    return np.concatenate([common, _components(rest, wanted - common.shape[1])], axis=1)


def _components(y: Float[np.ndarray, "n d"], count: int) -> Float[np.ndarray, "n q"]:
    """Return principal components, each of unit mean square; noise where y has no more."""
    u = np.linalg.svd(y - y.mean(axis=0), full_matrices=False)[0][:, :count]
    random = np.random.default_rng(0)
    lacking = 0.1 * random.normal(size=(len(y), count - u.shape[1]))
    return np.concatenate([u * np.sqrt(len(y)), lacking], axis=1)


def _hyperparameters(model: "SharedGPLVM") -> dict[str, np.ndarray]:
    values: dict[str, np.ndarray] = {}
    if model.dynamics is not None:
        values["alpha"] = np.array(model.dynamics.medians)
    for name, size in model.private_sizes().items():
        wide = model.latent_size + size
        values[f"{name}_gamma"] = np.full([wide] if model.relevance else [], 1.0 / wide)
        for part, value in (("variance", 1.0), ("linear", 0.1), ("beta", 5.0)):
            values[f"{name}_{part}"] = np.array(value)
    return values
