"""Small instances of the multifactor model, for simulation-based calibration.

The model is the one given, on few frames. With a circle: three clips of eight frames and
three features, of two levels of each factor, at a frame rate at which a clip takes a second.
That is about one cycle, so that the data can tell the steps and phases, and the posterior
has one region that matters for nearly all data the prior gives. With a path: two clips of six
frames and three features, two people.
"""

from collections.abc import Mapping
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PRNGKeyArray
from numpyro import distributions as dist

from ...distributions.dynamics import GPDynamics
from ...distributions.unit_paths import draw_unit_path
from ...gp.linalg import AnyArray
from ...model import NoiseMeaning, SBCCase, Values, draw_sites, logs, shuffled
from .frames import Frames, frames_of
from .identified import pairs
from .program import MultifactorProgram

FRAMES, PATH_FRAMES, FEATURES, RATE = 8, 6, 3, 8.0
# Frames of a path whose distances count.
SHOWN = 4
# The first factor has two levels in three clips, the others differ within the first level.
FIRST, OTHERS = ("a", "a", "b"), ("c", "d", "c")
PAIR = (0, 2)
NOISE: tuple[tuple[str, NoiseMeaning], ...] = (("beta", "precision"),)
POSITIVE = ("gamma", "beta", "alpha", "residual_variance", "residual_time", "step", "scale")


def case(model: MultifactorProgram) -> tuple[SBCCase, Frames]:
    """Return the case of a model, and its data; balanced dynamics are refused when it is run."""
    names = [factor.name for factor in model.style_factors]
    if model.on_circle:
        frames = small_frames(names, tuple(range(len(FIRST))), FRAMES)
        return SBCCase(model, _draw, _shuffle, quantities, "gamma", NOISE), frames
    frames = small_frames(names, PAIR, PATH_FRAMES)
    return SBCCase(model, _draw_path, _shuffle, quantities, "gamma", NOISE), frames


def small_frames(names: list[str], clips: tuple[int, ...], length: int) -> Frames:
    """Return the frames of the small data set, with zeros for poses."""
    parts = {f"clip {clip}": np.zeros((length, FEATURES)) for clip in clips}
    levels = {name: FIRST if index == 0 else OTHERS for index, name in enumerate(names)}
    labels = {name: {f"clip {clip}": each[clip] for clip in clips} for name, each in levels.items()}
    known = {name: list(dict.fromkeys(each.values())) for name, each in labels.items()}
    return frames_of(parts, labels, known, frame_rate=RATE)


def _draw(model: MultifactorProgram, key: PRNGKeyArray, frames: Frames) -> tuple[Values, Frames]:
    values = draw_sites(model, key, frames)
    return values, replace(frames, y=values.pop("y"))


def _draw_path(
    model: MultifactorProgram, key: PRNGKeyArray, frames: Frames
) -> tuple[Values, Frames]:
    """Draw the path and its hyperparameters together, then all that depends on them."""
    path_key, key = jax.random.split(key)
    medians = jnp.log(jnp.asarray(model.alpha_median(frames.frame_rate)))
    shape = (len(frames.clip), model.path.size)

    def path_of(alpha: Array) -> GPDynamics:
        return GPDynamics(model.dynamics_alpha({"alpha": alpha}), frames.steps, shape)

    alpha, x = draw_unit_path(path_key, dist.LogNormal(medians, 1.0).to_event(1), path_of)
    values = draw_sites(model, key, frames, {"alpha": alpha, "x": x})
    return values, replace(frames, y=values.pop("y"))


def _shuffle(key: PRNGKeyArray, frames: Frames) -> Frames:
    """Put the frames of every clip in a random order."""
    return replace(frames, y=shuffled(key, frames.y, frames.clip))


def quantities(model: MultifactorProgram, frames: Frames, values: Mapping[str, AnyArray]) -> Values:
    """Return what data can tell of a draw.

    Logarithms of the positive sites, phases relative to the first clip's, inner products
    of the style vectors (rows of the lower triangle but the first entry, which is one),
    and sqrt(gamma) times the distances of frames spread over a latent path.
    """
    out = logs(values, POSITIVE)
    for factor in model.style_factors:
        style = jnp.asarray(values[f"style_{factor.name}"])
        rows, columns = np.tril_indices(style.shape[0])
        out[f"gram_{factor.name}"] = (style @ style.T)[rows[1:], columns[1:]]
    if "phase" in values:
        out["phase"] = jnp.asarray(values["phase"])[1:]
    if not model.on_circle:
        x = model.latent_points(frames, values)["content"][:: len(frames.clip) // SHOWN]
        first, second = pairs(SHOWN)
        away = jnp.sqrt(jnp.sum((x[first] - x[second]) ** 2, axis=1))
        out["distance"] = jnp.sqrt(values["gamma"]) * away
    return out
