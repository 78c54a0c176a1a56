"""What a trained shared model says of new clips along a path.

Along a path x* every view is told by its process given the training frames, and by what is
seen of the view in the new clips themselves (`gp.matrix_normal.smooth`). Through inducing
points every frame is told by itself.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp

from ...distributions.dynamics import GivenSteps, given_steps
from ...distributions.dynamics import kernel as dynamics_kernel
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import complete, smooth
from ...gp.matrix_normal import condition as condition_exactly
from ...gp.sparse import SparsePosterior, condition_sparse
from ...prediction import GPPredictive
from .back_constraint import Identity
from .data import Views
from .processes import (
    ExactPosterior,
    Trained,
    moments,
    unit_scale,
    view_covariance,
    view_kernel,
    view_points,
)

if TYPE_CHECKING:
    from .program import SharedGPLVM

Points = dict[str, AnyArray]


def condition(model: "SharedGPLVM", frames: Views, values: Mapping[str, AnyArray]) -> Trained:
    """Condition a model on training frames: on all where the back-constraint makes all points."""
    x, private, every = _training_points(model, frames, values)
    views = {}
    for name in model.views:
        points = view_points(name, values, x, private)
        y, missing = (frames.y[name], frames.missing[name]) if every else frames.kept_of(name)
        beta, kernel = jnp.asarray(values[f"{name}_beta"]), view_kernel(name, values)
        if frames.exact:
            known = condition_exactly(y, view_covariance(name, values, points), missing)
            views[name] = ExactPosterior(kernel, points, known, beta)
        else:
            rows = jnp.asarray(frames.kept) if every else jnp.arange(x.shape[0])
            inducing = {"x": points["x"][rows[jnp.asarray(frames.inducing)]]}
            views[name] = condition_sparse(kernel, points, inducing, beta, y, missing)
    kept = x[jnp.asarray(frames.kept)] if every else x
    mean, scale = jnp.zeros(model.latent_size), jnp.ones(())
    if model.back is not None:
        mean, scale = unit_scale(kept)
    steps = _steps(model, frames, values, (kept - mean) / scale)
    own = {f"{name}_private": points for name, points in private.items()}
    every_value = {**values, "x": x, **own}
    known_values: Points = {name: jnp.asarray(value) for name, value in every_value.items()}
    trained = Trained(known_values, views, steps, mean, scale, jnp.asarray(frames.centres))
    return jax.tree.map(jnp.asarray, trained)


def _training_points(
    model: "SharedGPLVM", frames: Views, values: Mapping[str, AnyArray]
) -> tuple[AnyArray, Points, bool]:
    """Return shared and private points, and whether they are of all frames or the kept ones."""
    mapped = None if model.back is None else model.back.view
    free = [name for name, size in model.private_sizes().items() if size and name != mapped]
    private: Points = {name: jnp.asarray(values[f"{name}_private"]) for name in free}
    if mapped is None:
        return jnp.asarray(values["x"]), private, False
    inputs = frames.inputs[frames.kept] if free else frames.inputs
    x, own = model.mapped(inputs, frames.centres, values)
    return x, {**own, **private}, not free


def _steps(
    model: "SharedGPLVM", frames: Views, values: Mapping[str, AnyArray], x: AnyArray
) -> GivenSteps | SparsePosterior | None:
    if model.dynamics is None:
        return None
    alpha = model.dynamics.hyperparameters(values["alpha"])
    if frames.exact:
        return given_steps(alpha, x, frames.steps)
    before, after = x[frames.steps.before], x[frames.steps.after]
    inducing = {"x": before[jnp.asarray(frames.step_inducing)]}
    return condition_sparse(
        dynamics_kernel(alpha), {"x": before}, inducing, alpha[-1], after, complete(*after.shape)
    )


def new_points(
    model: "SharedGPLVM", trained: Trained, frames: Views, values: Mapping[str, AnyArray]
) -> tuple[AnyArray, Points]:
    """Return the shared path of new clips, and the private ones."""
    private: Points = {
        name: jnp.asarray(values[key])
        for name in model.views
        if (key := f"{name}_private") in values
    }
    if model.back is None:
        return jnp.asarray(values["x"]), private
    x, own = model.mapped(frames.inputs, trained.centres, trained.values)
    identity = isinstance(model.back.map, Identity)
    return x if identity else jnp.asarray(values["x"]), {**private, **own}


def predict(
    model: "SharedGPLVM", trained: Trained, frames: Views, values: Mapping[str, AnyArray]
) -> dict[str, GPPredictive]:
    """Predict every entry of all views, given what is seen of them."""
    x, private = new_points(model, trained, frames, values)
    found = {}
    for name in model.views:
        beta, missing = trained.values[f"{name}_beta"], frames.missing[name]
        points = view_points(name, trained.values, x, private)
        mean, covariance = moments(trained.views[name], points)
        noise = jnp.eye(len(mean)) / beta
        mean, covariance = smooth(frames.y[name], mean, covariance, noise, missing)
        ones = jnp.ones(mean.shape[1])
        found[name] = GPPredictive(mean, covariance, 1.0 / beta, ones, jnp.asarray(missing.columns))
    return found
