"""Where a new clip's pace and style are unlike those of all training clips.

A model trained on few people goes on, sure of itself, where it knows nothing.
"""

from collections.abc import Iterator, Mapping
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...gp.linalg import AnyArray
from .frames import Frames
from .prediction import Trained
from .program import MultifactorProgram

# A pace may be this many times the fastest trained one, or the slowest by it.
PACE = 1.1
# Prior correlation of a style with the most similar trained one, the content being the same,
# and how many times their prior sd is.
LEAST_ALIKE, MOST_SD = 0.5, 2.0


def novelty(
    model: MultifactorProgram, trained: Trained, frames: Frames, values: Mapping[str, AnyArray]
) -> list[str]:
    """Return a sentence for a pace, and for styles, that no training clip has."""
    return [*_pace(model, trained, frames, values), *_style(model, trained, frames, values)]


def _pace(
    model: MultifactorProgram, trained: Trained, frames: Frames, values: Mapping[str, AnyArray]
) -> Iterator[str]:
    if not model.on_circle:
        return
    a_second = float(frames.frame_rate) / (2.0 * np.pi)
    known = np.asarray(trained.values["step"]) * a_second
    for pace in np.asarray(values["step"]) * a_second:
        if not known.min() / PACE <= pace <= known.max() * PACE:
            yield (
                f"its pace of {pace:.2f} cycles a second lies outside that of the training "
                f"clips, {known.min():.2f} to {known.max():.2f}"
            )


def _style(
    model: MultifactorProgram, trained: Trained, frames: Frames, values: Mapping[str, AnyArray]
) -> Iterator[str]:
    """Compare as the kernel does: it sees no rotation, sign or common length of vectors."""
    names = [factor.name for factor in model.style_factors]
    if not any(f"style_{name}" in values for name in names):
        return
    both = np.asarray(_covariance(model, trained, frames, dict(values)))
    clips = len(np.asarray(frames.steps.first))
    variance, variances = np.split(np.diagonal(both), [clips])
    alike = both[:clips, clips:] / np.sqrt(np.outer(variance, variances))
    low, high = np.sqrt(variances.min()) / MOST_SD, np.sqrt(variances.max()) * MOST_SD
    for most, sd in zip(alike.max(axis=1), np.sqrt(variance), strict=True):
        if most < LEAST_ALIKE:
            yield (
                "its style is unlike that of every training clip: "
                f"the most similar correlates by {most:.2f}"
            )
        if not low <= sd <= high:
            yield (
                f"its style vectors are {sd / np.sqrt(np.median(variances)):.2f} times as long "
                "as is usual among the training clips"
            )


@partial(jax.jit, static_argnames="model")
def _covariance(
    model: MultifactorProgram, trained: Trained, frames: Frames, values: Mapping[str, AnyArray]
) -> Float[Array, "c c"]:
    """Return the covariance of new clips and trained ones, the content being the same."""
    own, known = model.latent_points(frames, values, trained), trained.points
    new, firsts = (jnp.asarray(each.steps.first) for each in (frames, trained.frames))
    points = {
        factor.name: jnp.concatenate(
            [jnp.asarray(own[factor.name])[new], jnp.asarray(known[factor.name])[firsts]]
        )
        for factor in model.style_factors
    }
    points["content"] = jnp.zeros((len(new) + len(firsts), jnp.shape(own["content"])[1]))
    return model.kernel(trained.hyper).matrix(points, points)
