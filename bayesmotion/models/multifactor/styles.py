"""Motions of any path of styles: their steps, and what the trained process says of them.

The step of the phase comes from a multilinear map of the styles, fitted to the training clips'
steps (Wang, Fleet and Hertzmann 2007, section 4.2); poses are what the process predicts at the
styles and on the circle.
"""

from collections.abc import Mapping
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from ...distributions.circle import circle
from ...errors import InputError
from ...gp.linalg import AnyArray
from ...prediction import GPPredictive
from .frames import Frames
from .program import MultifactorProgram
from .settings import Factor


def moved_by(model: MultifactorProgram) -> tuple[Factor, ...]:
    """Return the factors of a model that has a phase.

    Raises
    ------
    InputError
        If content is not on a circle, or there are no factors.
    """
    if not model.on_circle or not model.style_factors:
        raise InputError(
            "a fit of multifactor",
            "synthesis needs style factors, and content on a circle",
            "Fit Multifactor(content=Circle()) with factors",
        )
    return model.style_factors


def step_map(
    model: MultifactorProgram, frames: Frames, values: Mapping[str, AnyArray]
) -> Float[np.ndarray, "s ..."]:
    """Return the multilinear map from style vectors to the step, one axis a factor, of each draw.

    Least squares over the training clips; of all maps that fit equally well the one of the
    smallest norm.
    """
    step = np.asarray(values["step"])
    features, sizes = np.ones((len(step), frames.n_clips, 1)), []
    for factor in model.style_factors:
        learned = np.asarray(values[f"style_{factor.name}"])
        style = learned[:, np.asarray(frames.level[factor.name])]
        features = features[:, :, :, None] * style[:, :, None, :]
        features = features.reshape(len(step), frames.n_clips, -1)
        sizes.append(factor.size)
    weights = np.einsum("sfc,sc->sf", np.linalg.pinv(features), step)
    return weights.reshape(len(step), *sizes)


def features_of_styles(
    model: MultifactorProgram,
    frames: Frames,
    values: Mapping[str, AnyArray],
    styles: Mapping[str, AnyArray],
    phase: Float[np.ndarray, " n"],
    keys: Key[Array, " s"],
    samples: int,
) -> tuple[Float[Array, "s n d"], Float[Array, "s n d"], Float[Array, "s j n d"]]:
    """Return mean, variance and so many samples of the scaled features for every draw.

    Noise is included; samples are drawn by the keys of the draws.
    """
    content = jnp.asarray(circle(jnp.asarray(phase)))
    return _features(model, frames, values, styles, content, keys, samples)


@partial(jax.jit, static_argnames=("model", "samples"))
def _features(
    model: MultifactorProgram,
    frames: Frames,
    values: Mapping[str, AnyArray],
    styles: Mapping[str, AnyArray],
    content: Float[Array, "n q"],
    keys: Key[Array, " s"],
    samples: int,
) -> tuple[Float[Array, "s n d"], Float[Array, "s n d"], Float[Array, "s j n d"]]:
    def one(draw: tuple[dict[str, Array], dict[str, Array], Array]) -> tuple[Array, Array, Array]:
        sites, points, key = draw
        trained = model.condition(frames, sites)
        points = {**points, "content": content}
        own = model.kernel(trained.hyper).matrix(points, points)
        mean, covariance = model.outputs(trained, points, own)
        said = GPPredictive(
            mean, covariance, 1.0 / trained.hyper["beta"], trained.hyper["scale"],
            jnp.asarray(trained.conditioned.missing.columns),
        )  # fmt: skip
        variance = jnp.asarray(said.variance)
        if samples == 0:
            return mean, variance, jnp.zeros((0, *mean.shape))
        return mean, variance, jax.vmap(said.sample)(jax.random.split(key, samples))

    sites = {name: jnp.asarray(value) for name, value in values.items()}
    return jax.lax.map(one, (sites, dict(styles), keys))
