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

from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import AnyArray, require_finite
from ..inference.density import ProgramDensity
from ..inference.draws import draw_keys, stacked
from ..inference.optimisation.mode import stack
from ..inference.optimisation.optimise import maximise
from ..inference.predicting import DRAWS, predict
from ..models.shared_gplvm import SharedGPLVM
from ..models.shared_gplvm.data import SharedData, Views
from ..models.shared_gplvm.processes import Trained
from ..models.voice_puppetry import VoicePuppetry
from ..models.voice_puppetry.data import VELOCITY, PuppetryData
from ..models.voice_puppetry.prediction import state_recursions
from ..models.voice_puppetry.trajectory import Normals, trajectory
from ..prediction import BernoulliMixture, GPPredictive, Mixture, mixture_of
from .cautions import cautions, warn

Start = Literal["A", "B"]
PATH_STEPS = 100


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
    if face not in fit.training.units():
        known = ", ".join(fit.training.units())
        raise InputError(repr(face), "the model has no such view", f"Use {known}")
    heard = audio.drop_vars(face, errors="ignore")
    warn("the face", cautions(fit, heard))
    if start is None:
        return predict(fit, heard, draws=draws, seed=seed, max_steps=max_steps).site(face)
    if not isinstance(fit.model, SharedGPLVM):
        raise InputError(f"start {start!r}", "the model has no such start", "Leave it out")
    if fit.model.back is None:
        raise InputError("start", "the model has no back-constraint to start from", "Leave it out")
    return _from_start(fit, fit.model.prepare(heard, fit.training), face, draws, start, max_steps)


def sound_clip(fit: Fit, features: Float[np.ndarray, "t d"], audio: str = "audio") -> xr.Dataset:
    """Return features of sound as recordings of one clip, as the fit was trained on."""
    if audio not in fit.motion:
        raise InputError(repr(audio), "the fit has no such view", f"It has {[*fit.motion]}")
    dims, clip = fit.motion[audio].dims, np.repeat("clip", len(features))
    return xr.Dataset({audio: (dims, features)}, {"clip": ("frame", clip)})


def _from_start(
    fit: Fit, new: SharedData, face: str, draws: int, start: Start, max_steps: int
) -> Mixture | BernoulliMixture:
    """Mix over draws what is said along the mode that a start leads to."""
    model, density = fit.model, ProgramDensity(fit.model)
    values, _ = stacked(fit, draws)
    entries = []
    for index, key in enumerate(draw_keys(0, values)):
        draw = {name: value[index] for name, value in values.items()}
        trained = _condition(model, fit.training.data[0], draw)
        starts = model.initial_values(new, 0, 2, trained)
        first, data = starts[min("AB".index(start), len(starts) - 1)], (*new.data, trained)
        own = first
        if first:
            real = stack([density.real(first, data)])
            optimum = maximise(density, real, data, max_steps=max_steps)
            require_finite(optimum.log_density[0], "path")
            own = density.natural(optimum.best(), data)
        entries.append(_predict(model, trained, new.data[0], own)[face].marginals(key))
    every = jax.tree.map(lambda *parts: jnp.stack(parts), *entries)
    weight = np.full(len(entries), 1.0 / len(entries))
    return mixture_of(every, weight).rescaled(*new.units()[face])


@partial(jax.jit, static_argnames="model")
def _condition(model: SharedGPLVM, frames: Views, values: dict[str, AnyArray]) -> Trained:
    return model.condition(frames, values)


@partial(jax.jit, static_argnames="model")
def _predict(
    model: SharedGPLVM, trained: Trained, frames: Views, own: dict[str, AnyArray]
) -> dict[str, GPPredictive]:
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
    if not isinstance(model, VoicePuppetry) or not model.velocity:
        raise InputError(
            "trajectory", "the model has no states with velocities", "Use `audio_to_face`"
        )
    new = model.prepare(audio.drop_vars(model.face, errors="ignore"), fit.training)
    values, _ = stacked(fit, draws)
    count = len(next(iter(values.values())))
    made = [
        _trajectory(model, new, {n: np.asarray(v[i]) for n, v in values.items()})
        for i in range(count)
    ]
    units = new.units()[model.face]
    return units.location + units.scale * np.mean(made, axis=0)


def _trajectory(
    model: VoicePuppetry, new: PuppetryData, values: dict[str, np.ndarray]
) -> Float[np.ndarray, "t d"]:
    """Return the trajectory of one draw, scaled as the face is."""
    trained = model.condition(new.frames, values)
    _, found = state_recursions(model, trained, new.frames)
    face, moving = (values[f"{model.face}{part}_mean"] for part in ("", VELOCITY))
    position = Normals(face, values[f"{model.face}_precision"])
    # Velocities have a mean and a scale of their own: brought to steps of the scaled face.
    units, own = new.units()[model.face], new.units()[model.face + VELOCITY]
    ratio = units.scale / own.scale
    precision = values[f"{model.face}{VELOCITY}_precision"]
    velocity = Normals(
        (moving + own.location / own.scale) / ratio, precision * ratio[:, None] * ratio[None, :]
    )
    occupied = np.exp(np.asarray(found.posterior))
    return trajectory(position, velocity, occupied, np.asarray(new.frames.begins))


__all__ = ["DRAWS", "Start", "audio_to_face", "puppet_trajectory", "sound_clip"]
