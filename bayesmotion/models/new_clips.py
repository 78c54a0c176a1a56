"""Where the search for a new clip's unknowns begins, given a trained model."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from ..priors.circle import circle
from ..priors.dynamics import roll_out, with_path
from .multifactor import Multifactor
from .poses import Frames
from .predicting import Given

PHASES = 8
SEGMENTS = 24
# What a spare entry begins at, for a style of length one.
SPARE = 0.3


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
    the stretches of training clips that look most like the frames seen.
    """
    if model.dynamics == "circle":
        return [
            {
                **_as_clip(model, frames, training, values, clip),
                "phase_point": np.asarray(circle(np.array([2.0 * np.pi * k / PHASES]))),
                "step": values["step"][clip : clip + 1],
            }
            for clip in range(training.n_clips)
            for k in range(PHASES)
        ]
    n = len(frames.clip)
    content = np.asarray(given.points["content"])
    starts = []
    for first in _segments(frames, training):
        clip = int(np.asarray(training.clip)[first])
        x = content[first : first + n]
        x = np.concatenate([x, np.repeat(x[-1:], n - len(x), axis=0)])
        starts.append({**_as_clip(model, frames, training, values, clip), "x": x})
    return starts


def _as_clip(model, frames, training, values, clip) -> dict[str, np.ndarray]:
    """A training clip's own deviation, and its styles for the factors whose level is new.

    The styles are given something of every spare entry: at zero the density is level in
    them, and the search would stay. It does stay at zero in other entries that no trained
    vector has, where there are fewer levels than entries: those are left to the sampler.
    """
    own = ("drift", "drift_time") if model.noise == "own_drift" else ()
    out = {name: values[name][clip : clip + 1] for name in own}
    for factor, count in zip(model.factors, frames.levels, strict=True):
        style = values[f"style_{factor.name}"]
        if count > len(style):
            level = np.asarray(training.level[factor.name])[clip]
            more = np.full(factor.spare, SPARE * np.linalg.norm(style[level]))
            out[f"style_{factor.name}"] = np.concatenate([style[level], more])[None]
    return out


def _segments(frames: Frames, training: Frames) -> list[int]:
    """First frames of the training stretches nearest to the frames seen, nearest first."""
    seen = np.einsum("pn,pd->nd", frames.missing.rows, frames.missing.columns)
    y, trained, clip = (np.asarray(a) for a in (frames.y, training.y, training.clip))
    n = len(y)
    # A clip longer than every training clip is compared over as much as there is.
    room = min(n, int(np.bincount(clip).max()))
    firsts = [i for i in range(len(trained) - room + 1) if clip[i] == clip[i + room - 1]]
    distance = [np.mean(seen[:room] * (trained[i : i + room] - y[:room]) ** 2) for i in firsts]
    order = np.argsort(distance, kind="stable")
    return [firsts[i] for i in order[:SEGMENTS]]


def extend(
    model: Multifactor, values: Mapping[str, np.ndarray], given: Given, length: int
) -> dict[str, np.ndarray]:
    """Let a new clip's sites go on to `length` frames.

    Phase and step go on by themselves; a latent path goes on by the
    dynamics' mean, given the training steps and its own: it keeps its own speed.
    """
    if model.dynamics == "circle" or given.steps is None:
        return dict(values)
    x = jnp.asarray(values["x"])
    return {**values, "x": np.asarray(roll_out(with_path(given.steps, x), x, length))}
