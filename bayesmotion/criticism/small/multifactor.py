"""Small multifactor models.

circle_white, circle_drift, circle_own_drift
    Three clips of eight frames and three features: one person in two gaits, another in one
    of them, a frame rate at which a clip takes a second. That is about one cycle, so that
    the data can tell the steps and phases, and the posterior has one region that matters
    for nearly all data the prior gives.
gp_first, gp_second
    Two clips of six frames and three features, two people in one gait, paths in the plane
    whose dynamics have a noise that short chains get around in.
gp_balanced
    Refused.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PRNGKeyArray
from numpyro import distributions as dist

from ...gp.linalg import AnyArray
from ...model import SBCCase, Values, draw_sites, logs, shuffled
from ...models.factors import Factor
from ...models.multifactor import Dynamics, Multifactor, Noise
from ...models.multifactor_identified import pairs
from ...models.poses import Frames, frames_of
from ...priors.dynamics import GPDynamics
from ...priors.unit_paths import draw_unit_path

Order = Literal[1, 2]
FRAMES, PATH_FRAMES, FEATURES, RATE = 8, 6, 3, 8.0
# Frames of a path whose distances count.
SHOWN = 4
LABELS = {
    "subject": {"ann-walk": "ann", "ann-run": "ann", "ben-walk": "ben"},
    "gait": {"ann-walk": "walk", "ann-run": "run", "ben-walk": "walk"},
}
LEVELS = {"subject": ["ann", "ben"], "gait": ["walk", "run"]}
PERSON, PAIR = ("subject",), ("ann-walk", "ben-walk")
NOISES: dict[str, Noise] = {
    "circle_white": "white",
    "circle_drift": "drift",
    "circle_own_drift": "own_drift",
}
PATHS: dict[str, tuple[Order, Dynamics]] = {
    "gp_first": (1, "gp"),
    "gp_second": (2, "gp"),
    "gp_balanced": (2, "balanced"),
}
POSITIVE = ("gamma", "beta", "alpha", "drift", "drift_time", "step", "scale")


def trial(kind: str) -> tuple[SBCCase, Frames]:
    """Give the small model of a kind and its data."""
    if kind in NOISES:
        return circle_trial(small_circle(NOISES[kind])), small_frames()
    model = small_path(*PATHS[kind])
    return path_trial(model), small_frames(PAIR, PERSON, PATH_FRAMES)


def small_frames(
    clips: tuple[str, ...] = tuple(LABELS["subject"]),
    factors: tuple[str, ...] = tuple(LEVELS),
    length: int = FRAMES,
) -> Frames:
    """Give the frames of the small data set, with zeros for poses."""
    parts = {clip: np.zeros((length, FEATURES)) for clip in clips}
    known = {factor: LEVELS[factor] for factor in factors}
    return frames_of(parts, LABELS, known, frame_rate=RATE)


def small_circle(noise: Noise, factors: tuple[str, ...] = tuple(LEVELS)) -> Multifactor:
    """Give the model on the circle with style vectors of two numbers."""
    return Multifactor("circle", _sized(factors), content_size=2, noise=noise, freedom=None)


def small_path(order: Order, dynamics: Dynamics = "gp") -> Multifactor:
    """Give the model of two people with Gaussian process dynamics in the plane."""
    return Multifactor(
        dynamics,
        _sized(PERSON),
        content_size=2,
        noise="white",
        freedom=None,
        order=order,
        dynamics_noise=0.3,
    )


def _sized(factors: tuple[str, ...]) -> tuple[Factor, ...]:
    return tuple(Factor(name, size=2, spare=0) for name in factors)


def circle_trial(model: Multifactor) -> SBCCase:
    """Give the trial of a model on the circle."""
    return SBCCase(model, _draw, _shuffle, quantities, "gamma", (("beta", "precision"),))


def path_trial(model: Multifactor) -> SBCCase:
    """Give the trial of a model with Gaussian process dynamics."""
    return SBCCase(model, _draw_path, _shuffle, quantities, "gamma", (("beta", "precision"),))


def _draw(model: Multifactor, key: PRNGKeyArray, frames: Frames) -> tuple[Values, Frames]:
    values = draw_sites(model, key, frames)
    return values, replace(frames, y=values.pop("y"))


def _draw_path(model: Multifactor, key: PRNGKeyArray, frames: Frames) -> tuple[Values, Frames]:
    """Draw the path and its hyperparameters together, then all that depends on them."""
    path_key, key = jax.random.split(key)
    medians = jnp.log(jnp.asarray(model.alpha_median(frames.frame_rate)))
    shape = (len(frames.clip), model.content_size)

    def path_of(alpha: Array) -> GPDynamics:
        return GPDynamics(model.dynamics_alpha({"alpha": alpha}), frames.steps, shape)

    alpha, x = draw_unit_path(path_key, dist.LogNormal(medians, 1.0).to_event(1), path_of)
    values = draw_sites(model, key, frames, {"alpha": alpha, "x": x})
    return values, replace(frames, y=values.pop("y"))


def _shuffle(key: PRNGKeyArray, frames: Frames) -> Frames:
    """Put the frames of every clip in a random order."""
    return replace(frames, y=shuffled(key, frames.y, frames.clip))


def quantities(model: Multifactor, frames: Frames, values: Mapping[str, AnyArray]) -> Values:
    """Give what data can tell of a draw.

    Logarithms of the positive sites, phases relative to the first clip's, inner products
    of the style vectors (rows of the lower triangle but the first entry, which is one),
    and sqrt(gamma) times the distances of frames spread over a latent path.
    """
    out = logs(values, POSITIVE)
    for factor in model.factors:
        style = jnp.asarray(values[f"style_{factor.name}"])
        rows, columns = np.tril_indices(style.shape[0])
        out[f"gram_{factor.name}"] = (style @ style.T)[rows[1:], columns[1:]]
    if "phase" in values:
        out["phase"] = jnp.asarray(values["phase"])[1:]
    if model.dynamics != "circle":
        x = model.points(frames, values)["content"][:: len(frames.clip) // SHOWN]
        first, second = pairs(SHOWN)
        away = jnp.sqrt(jnp.sum((x[first] - x[second]) ** 2, axis=1))
        out["distance"] = jnp.sqrt(values["gamma"]) * away
    return out
