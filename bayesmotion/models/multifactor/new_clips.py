"""Where the search for new clips' unknowns begins, given a trained model."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpyro import handlers
from numpyro.infer.util import log_density

from ...distributions.circle import circle
from ...distributions.dynamics import roll_out, with_path
from .data import PoseData
from .frames import Frames, seen_entries_of
from .prediction import Trained
from .program import MultifactorProgram

PHASES = 8
SEGMENTS = 24
# What a novel dimension begins at, for a style of length one.
NOVEL = 0.3


def new_values(
    model: MultifactorProgram, data: PoseData, count: int, trained: Trained
) -> list[dict[str, np.ndarray]]:
    """Return initial values of new clips' sites, at most `count`.

    On a circle: the styles and step of every training clip, at phases all around the circle.
    With Gaussian process dynamics: the latent path and styles of the stretches of training
    clips that look most like what is seen, going on by the dynamics' mean. Of several clips
    each has its candidates in the order of their density.
    """
    each = [_candidates(model, frames, trained) for frames in data.alone]
    if len(each) == 1 and len(each[0]) <= count:
        return each[0]
    ranked = [_ranked(model, frames, trained, some)
              for frames, some in zip(data.alone, each, strict=True)]  # fmt: skip
    fewest = min(count, *map(len, ranked))
    return [_together(model, data, trained, [some[i] for some in ranked]) for i in range(fewest)]


def _candidates(
    model: MultifactorProgram, frames: Frames, trained: Trained
) -> list[dict[str, np.ndarray]]:
    """Return initial values for one clip."""
    training, values = trained.frames, trained.values
    if model.on_circle:
        wander = {"wander": np.zeros((1, 2))} if model.wander_sd else {}
        return [
            {
                **as_clip(model, frames, trained, clip),
                **wander,
                "phase_point": np.asarray(circle(np.array([2.0 * np.pi * k / PHASES]))),
                "step": np.asarray(values["step"])[clip : clip + 1],
            }
            for clip in range(training.n_clips)
            for k in range(PHASES)
        ]
    content, n = np.asarray(trained.points["content"]), len(frames.clip)
    seen = np.flatnonzero(seen_entries_of(frames).any(axis=1))
    known = int(seen[-1]) + 1 if len(seen) else n
    out = []
    for first in _segments(frames, training, known):
        clip = int(np.asarray(training.clip)[first])
        x = content[first : first + known]
        x = np.concatenate([x, np.repeat(x[-1:], known - len(x), axis=0)])
        if known < n and trained.steps is not None:
            x = jnp.asarray(x)
            x = np.asarray(roll_out(with_path(trained.steps, x), x, n))
        out.append({**as_clip(model, frames, trained, clip), "x": x})
    return out


def as_clip(
    model: MultifactorProgram, frames: Frames, trained: Trained, clip: int
) -> dict[str, np.ndarray]:
    """Return a training clip's own residual, and its styles for the factors whose level is new.

    The styles are given something of every novel dimension: at zero the density is level in
    them, and the search would stay. It does stay at zero in other entries that no trained
    vector has, where there are fewer levels than entries: those are left to the sampler.
    """
    values = {name: np.asarray(value) for name, value in trained.values.items()}
    own = ("residual_variance", "residual_time") if model.per_clip else ()
    out = {name: values[name][clip : clip + 1] for name in own}
    for factor, count in zip(model.style_factors, frames.levels, strict=True):
        style = values[f"style_{factor.name}"]
        if count > len(style):
            level = np.asarray(trained.frames.level[factor.name])[clip]
            more = np.full(factor.novel, NOVEL * np.linalg.norm(style[level]))
            out[f"style_{factor.name}"] = np.concatenate([style[level], more])[None]
    return out


def _segments(frames: Frames, training: Frames, known: int) -> list[int]:
    """First frames of the training stretches nearest to the frames seen, nearest first."""
    seen = seen_entries_of(frames)[:known]
    y, trained, clip = (np.asarray(a) for a in (frames.y[:known], training.y, training.clip))
    n = len(y)
    # A clip longer than every training clip is compared over as much as there is.
    room = min(n, int(np.bincount(clip).max()))
    firsts = [i for i in range(len(trained) - room + 1) if clip[i] == clip[i + room - 1]]
    distance = [np.mean(seen[:room] * (trained[i : i + room] - y[:room]) ** 2) for i in firsts]
    order = np.argsort(distance, kind="stable")
    return [firsts[i] for i in order[:SEGMENTS]]


def _ranked(
    model: MultifactorProgram,
    frames: Frames,
    trained: Trained,
    candidates: list[dict[str, np.ndarray]],
) -> list[dict[str, np.ndarray]]:
    """Return candidates of one clip in the order of their density."""
    stacked = {name: np.stack([one[name] for one in candidates]) for name in candidates[0]}
    densities = np.asarray(_densities(model, frames, trained, stacked))
    order = np.argsort(-np.where(np.isfinite(densities), densities, -np.inf), kind="stable")
    return [candidates[i] for i in order]


@partial(jax.jit, static_argnames="model")
def _densities(model: Any, frames: Frames, trained: Trained, values: Mapping[str, Array]) -> Array:
    def one(sites: Mapping[str, Array]) -> Array:
        program = handlers.substitute(model.program, data=dict(sites))
        return jnp.asarray(log_density(program, (frames, trained), {}, {})[0])

    return jax.lax.map(one, dict(values))


def _together(
    model: MultifactorProgram, data: PoseData, trained: Trained, each: list[dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Return values for all clips, of values for each; a level's style is its first clip's."""
    out = {
        name: np.concatenate([one[name] for one in each])
        for name in each[0]
        if not name.startswith("style_")
    }
    for factor, count in zip(model.style_factors, data.frames.levels, strict=True):
        known = len(np.asarray(trained.values[f"style_{factor.name}"]))
        level = np.asarray(data.frames.level[factor.name])
        first = [int(np.argmax(level == new)) for new in range(known, count)]
        if first:
            name = f"style_{factor.name}"
            out[name] = np.concatenate([each[clip][name] for clip in first])
    return out
