"""Where the search for a new clip's unknowns begins, given a trained model."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..priors.dynamics import next_mean
from .multifactor import Given, Multifactor
from .poses import Frames

PHASES = 8
SEGMENTS = 24


def new_clip_starts(
    model: Multifactor,
    frames: Frames,
    training: Frames,
    values: Mapping[str, np.ndarray],
    given: Given,
) -> list[dict[str, np.ndarray]]:
    """Give starting values of one new clip's sites.

    With circle dynamics: the styles and step of every training clip, at phases all
    around the circle. With Gaussian process dynamics: the latent path and styles of
    the stretches of training clips that look most like the frames seen, followed by
    the dynamics' mean.
    """
    if model.dynamics == "circle":
        return [
            {
                **_styles(model, frames, training, values, clip),
                "phase": np.array([2.0 * np.pi * k / PHASES]),
                "step": values["step"][clip : clip + 1],
            }
            for clip in range(training.n_clips)
            for k in range(PHASES)
        ]
    seen = int(np.asarray(frames.missing.rows).max(axis=0).sum())
    starts = []
    for first in _segments(frames, training, seen):
        clip = int(np.asarray(training.clip)[first])
        x = _path(model, frames, values, given, first, seen)
        starts.append({**_styles(model, frames, training, values, clip), "x": x})
    return starts


def _styles(model, frames, training, values, clip) -> dict[str, np.ndarray]:
    """Styles of a training clip, for the factors whose level is new."""
    out = {}
    for factor, count in zip(model.factors, frames.levels, strict=True):
        style = values[f"style_{factor.name}"]
        if count > len(style):
            level = np.asarray(training.level[factor.name])[clip]
            out[f"style_{factor.name}"] = style[level][None]
    return out


def _segments(frames: Frames, training: Frames, seen: int) -> list[int]:
    """First frames of the training stretches nearest to the frames seen, nearest first."""
    y, all_y = np.asarray(frames.y)[:seen], np.asarray(training.y)
    clip = np.asarray(training.clip)
    candidates = [
        first for first in range(len(all_y) - seen + 1) if clip[first] == clip[first + seen - 1]
    ]
    if not candidates:
        # The clip is longer than every training clip: begin with single frames repeated.
        candidates = list(np.asarray(training.steps.first))
    distance = [
        np.mean((all_y[i : i + seen] - y[: len(all_y[i : i + seen])]) ** 2) for i in candidates
    ]
    order = np.argsort(distance, kind="stable")
    return [candidates[i] for i in order[:SEGMENTS]]


def _path(model, frames, values, given, first, seen) -> Float[np.ndarray, "n q"]:
    x = np.asarray(values["x"])[first : first + seen]
    path = [jnp.asarray(row) for row in x]
    alpha = given.hyper["alpha"]
    while len(path) < len(frames.clip):
        path.append(next_mean(alpha, given.steps, path[-1][None])[0])
    return np.stack([np.asarray(row) for row in path])
