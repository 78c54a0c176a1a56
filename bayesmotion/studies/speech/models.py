"""The speech study's models as functions: learn from clips of sound and face, then speak.

Sound is cepstra, `COEFFICIENTS` of them a frame; every model takes as many as it hears. Faces
may be any tracks: sensors in mm, or parameters of an appearance model.
"""

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...fit import Fit
from ...inference.methods import EM, MAP, fit
from ...models.shared_gplvm.published import PUBLISHED
from ...models.voice_puppetry import VoicePuppetry
from ...sensing.audio.cepstra import slopes
from ...sensing.face.views import views_of
from ...tasks.speech import Start, audio_to_face, puppet_trajectory, sound_clip
from ...tasks.speech_baselines import train_regression, train_ridge

COEFFICIENTS = 20
PLAIN = 13  # coefficients of the paper's models and of the regressions
STATES = 80  # of voice puppetry; with 40, training utterances left out were told worse
STEPS = 60  # of the search for a mode
EM_STEPS = 40

Clips = Sequence[Float[np.ndarray, "_ d"]]
Speak = Callable[[np.ndarray], np.ndarray]
Train = Callable[[Sequence[np.ndarray], Sequence[np.ndarray]], Speak]


def heard_by(model: str) -> int:
    """Return how many coefficients a shared model hears."""
    return COEFFICIENTS if model == "sgplvm_window" else PLAIN


def train_shared(views: xr.Dataset, model: str, seed: int) -> Fit:
    """Fit a shared model as the study does."""
    method = MAP(initial=1, keep=1, max_steps=STEPS)
    return fit(PUBLISHED[model], views, method=method, seed=seed)


def train_puppetry(views: xr.Dataset, seed: int, states: int = STATES) -> Fit:
    """Fit voice puppetry as the study does."""
    method = EM(max_steps=EM_STEPS, tolerance=1e-5)
    return fit(VoicePuppetry(states), views, method=method, seed=seed)


def with_slopes(sound: Float[np.ndarray, "t a"]) -> Float[np.ndarray, "t b"]:
    """Return the plain coefficients and their slopes, which voice puppetry hears."""
    plain = sound[:, :PLAIN]
    return np.hstack([plain, slopes(plain)])


def numbered(sounds: Clips, faces: Clips, coefficients: int) -> xr.Dataset:
    """Return clips as views, named by their numbers."""
    names = [f"{number:04}" for number in range(len(sounds))]
    heard = {name: clip[:, :coefficients] for name, clip in zip(names, sounds, strict=True)}
    labels = [f"f{number}" for number in range(faces[0].shape[1])]
    return views_of(heard, dict(zip(names, faces, strict=True)), labels)


def trainers(seed: int) -> dict[str, Train]:
    """Return every model of the study as a function that learns from clips."""

    def shared(model: str, start: Start) -> Train:
        heard = heard_by(model)

        def train(sounds: Clips, faces: Clips) -> Speak:
            trained = train_shared(numbered(sounds, faces, heard), model, seed)
            return lambda sound: audio_to_face(
                trained, sound_clip(trained, sound[:, :heard]), start=start
            ).means()

        return train

    def puppet(sounds: Clips, faces: Clips) -> Speak:
        listening = [with_slopes(sound) for sound in sounds]
        states = min(STATES, sum(map(len, sounds)) // 20)
        views = numbered(listening, faces, listening[0].shape[1])
        trained = train_puppetry(views, seed, states)
        return lambda sound: puppet_trajectory(trained, sound_clip(trained, with_slopes(sound)))

    def ridge(sounds: Clips, faces: Clips) -> Speak:
        made = train_ridge([sound[:, :PLAIN] for sound in sounds], faces)
        return lambda sound: made.speak(sound[:, :PLAIN])

    def regression(sounds: Clips, faces: Clips) -> Speak:
        made = train_regression([sound[:, :PLAIN] for sound in sounds], faces)
        return lambda sound: made.speak(sound[:, :PLAIN])[0]

    return {
        "sgplvm_a": shared("sgplvm", "A"),
        "sgplvm_b": shared("sgplvm", "B"),
        "sgplvm_window": shared("sgplvm_window", "A"),
        "voice_puppetry": puppet,
        "ridge": ridge,
        "gp_regression": regression,
    }
