"""From sound to face: what a fit of several views says of one, given another.

`audio_to_face` is a prediction of recordings whose face is missing altogether, averaged over
the draws of the fit (`inference.predicting`), for every model of views: shared processes, and
voice puppetry.

Deena and Galata (2009) begin the search for the latent path of new sound at one of two points,
the back-constraint (start A) or the likeliest path through training points (start B), and take
the mode it leads to. `start` does that, for every draw.

Voice puppetry's own answer is a `puppet_trajectory`: the smoothest face under the states'
normals of position and velocity (Brand 1999).
"""

from collections.abc import Mapping
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from ..catalogue import lacking
from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import AnyArray, require_finite
from ..inference.density import ProgramDensity, natural_values, real_values
from ..inference.draws import draw_keys, stacked
from ..inference.optimisation.optimise import maximise, stack
from ..inference.predicting import DRAWS, predict, require_model
from ..model import Model
from ..prediction import BernoulliMixture, Mixture, Predictive, mixture_of
from ..programs import one_at_a_time
from ..verbs import PredictsTrajectory, RelatesViews, StartsPaths
from .cautions import cautions, warn

Start = Literal["A", "B"]
PATH_STEPS = 100


@one_at_a_time
def audio_to_face(
    fit: Fit,
    audio: xr.Dataset,
    *,
    face: str = "face",
    draws: int = DRAWS,
    start: Start | None = None,
    max_steps: int = PATH_STEPS,
    seed: int = 0,
) -> Mixture | BernoulliMixture:
    """Return the face of sound, frame by frame, averaged over draws.

    Parameters
    ----------
    fit
        Of a model of views, such as `SharedGPLVM` or `VoicePuppetry`, by any method.
    audio
        Clips with the view that is heard (`sound_clip`); a face in them is not looked at.
    face
        The view that is asked for.
    draws
        At most so many draws of the fit, evenly spread.
    start
        Of a shared model: ``A`` or ``B``, the start of the paper from which one mode of the
        path is searched for; where None all modes that are found count by their mass.
    max_steps
        At most so many steps of that search.
    seed
        Of random parts.

    Returns
    -------
    A mixture (T, D), in the units of the training face.

    Raises
    ------
    InputError
        If the model has no such view, the sound is not as in training, or there is no such
        start.

    Warns
    -----
    MotionWarning
        If the sound trained the fit, or the fit's draws are not to be trusted.
    """
    model = fit.model
    if not isinstance(model, RelatesViews):
        raise lacking(model.name, "it tells no view from another", RelatesViews)
    if face not in model.views:
        raise InputError(
            repr(face), "the model has no such view", f"Use {' or '.join(model.views)}"
        )
    heard = audio.drop_vars(face, errors="ignore")
    warn("the face", cautions(fit, heard))
    if start is None:
        return predict(fit, heard, draws=draws, seed=seed, max_steps=max_steps).site(face)
    return _from_start(fit, heard, face, draws, start, max_steps)


def sound_clip(fit: Fit, features: Float[np.ndarray, "t d"], audio: str = "audio") -> xr.Dataset:
    """Return features of sound as recordings of one clip, as the fit was trained on."""
    if audio not in fit.motion:
        raise InputError(repr(audio), "the fit has no such view", f"It has {[*fit.motion]}")
    dims, clip = fit.motion[audio].dims, np.repeat("clip", len(features))
    return xr.Dataset({audio: (dims, features)}, {"clip": ("frame", clip)})


def _from_start(
    fit: Fit, heard: xr.Dataset, face: str, draws: int, start: Start, max_steps: int
) -> Mixture | BernoulliMixture:
    """Mix over draws what is said along the mode that a start leads to."""
    model = require_model(fit)
    if not isinstance(model, StartsPaths):
        raise lacking(model.name, f"it has no such start as {start!r}", StartsPaths)
    new, density = model.prepare(heard, fit.training), ProgramDensity(model)
    values, _ = stacked(fit, draws)
    entries = []
    for index, key in enumerate(draw_keys(0, values)):
        draw = {name: value[index] for name, value in values.items()}
        trained = _condition(model, fit.training.data[0], draw)
        first, data = model.path_start(new, trained, start), (*new.data, trained)
        own = first
        if first:
            real = stack([real_values(density, first, data)])
            optimum = maximise(density, real, data, max_steps=max_steps)
            require_finite(optimum.log_density[0], "path")
            own = natural_values(density, optimum.best(), data)
        entries.append(_predict(model, trained, new.data[0], own)[face].marginals(key))
    every = jax.tree.map(lambda *parts: jnp.stack(parts), *entries)
    weight = np.full(len(entries), 1.0 / len(entries))
    return mixture_of(every, weight).rescaled(*new.units()[face])


@partial(jax.jit, static_argnames="model")
def _condition(model: Model, frames: Any, values: dict[str, AnyArray]) -> Any:
    return model.condition(frames, values)


@partial(jax.jit, static_argnames="model")
def _predict(
    model: Model, trained: Any, frames: Any, own: Mapping[str, AnyArray]
) -> Mapping[str, Predictive]:
    return model.predict(trained, frames, own)


def puppet_trajectory(
    fit: Fit, audio: xr.Dataset, *, draws: int = DRAWS
) -> Float[np.ndarray, "t d"]:
    """Return the most probable face trajectory of sound, the mean over draws.

    Parameters
    ----------
    fit
        Of `VoicePuppetry` with velocities.
    audio
        Clips with the view that is heard; a face in them is not looked at.
    draws
        At most so many draws of the fit, evenly spread.

    Raises
    ------
    InputError
        If it is another model, or one without velocities.
    """
    model = fit.model
    if not isinstance(model, PredictsTrajectory):
        raise lacking(model.name, "it has no trajectory of its own", PredictsTrajectory)
    return model.trajectory(audio, fit.training, stacked(fit, draws)[0])


__all__ = ["DRAWS", "Start", "audio_to_face", "puppet_trajectory", "sound_clip"]
