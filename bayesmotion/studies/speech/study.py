"""Reproduce Deena and Galata (2009) on real speech: the face's motion from sound alone.

Ten repeats of a random split, 40 utterances to train and 12 others to test, of one speaker
with sensors on lips and tongue (`speech_data`). The shared GPLVM with its two starts, voice
puppetry, two plain regressions, and a shared model that looks at a window of sound. Every
setting was chosen by splitting the training utterances of the first three repeats.

Each repeat of each model is a stage that ``speech.json`` keeps: an interrupted run goes on
where it was.
"""

import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ...files import replacing, write_json
from ...fit import Fit, load
from ...models.shared_gplvm.published import PUBLISHED
from ...models.voice_puppetry import VoicePuppetry
from ...registry import describe_model
from ...sensing.face.views import FRAME_RATE, views_of
from ...tasks.speech import Start, audio_to_face, puppet_trajectory
from ...tasks.speech_baselines import train_regression, train_ridge
from ..stages import Say, Stages
from .data import COORDINATES, TEST, TRAINING, Utterances, read_utterances
from .figures import draw_figures
from .grid import grid_plan, grid_results
from .models import (
    COEFFICIENTS,
    EM_STEPS,
    PLAIN,
    STATES,
    STEPS,
    train_puppetry,
    train_shared,
    trainers,
    with_slopes,
)  # fmt: skip
from .scores import Faces, paired, scores, summary
from .talker import talker_plan, talker_results

REPEATS = 10
MODELS = ("sgplvm_a", "sgplvm_b", "sgplvm_window", "voice_puppetry", "ridge", "gp_regression")
PAIRS = (
    ("sgplvm_a", "voice_puppetry"), ("sgplvm_a", "ridge"), ("sgplvm_b", "sgplvm_a"),
    ("sgplvm_window", "gp_regression"), ("sgplvm_window", "sgplvm_a"),
)  # fmt: skip


class Repeat:
    """One split, and what is done with it; what is kept is in a folder of the settings' own."""

    def __init__(self, utterances: Utterances, number: int, seed: int, kept: Path) -> None:
        self.utterances, self.seed, self.number, self.kept = utterances, seed, number, kept
        self.training, self.test = utterances.split(number, seed)
        self.true = {name: utterances.face[name] for name in self.test}

    def score(
        self, model: str, speak: Callable[[], tuple[Faces, Faces | None]], seconds: float
    ) -> dict[str, float]:
        """Let a trained model speak all test utterances; the first is kept to be drawn."""
        began = time.perf_counter()
        mean, sd = speak()
        spoken = time.perf_counter() - began
        if self.number == 0:
            kept = {"mean": mean[self.test[0]], "true": self.true[self.test[0]]}
            if sd is not None:
                kept["spread"] = sd[self.test[0]]
            with replacing(self.kept / "tracks" / f"{model}.npz") as temporary:
                np.savez(temporary, allow_pickle=False, **kept)
        frames = sum(map(len, self.true.values()))
        times = {"training_seconds": seconds, "seconds_per_second": spoken / (frames / FRAME_RATE)}
        return {**scores(mean, self.true, sd), **times}

    @cached_property
    def plain(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Plain coefficients and faces of the training utterances."""
        sound = [self.utterances.sound[name][:, :PLAIN] for name in self.training]
        return sound, [self.utterances.face[name] for name in self.training]

    def shared(self, start: Start) -> dict[str, float]:
        """Score the paper's model, with one of its starts; both have one fit."""
        path = self.kept / f"sgplvm_{self.number}.nc"
        if not path.is_file():
            train_shared(self.views(PLAIN), "sgplvm", self.seed).save(path)
        return self._spoken(f"sgplvm_{start.lower()}", load(path), PLAIN, start)

    def window(self) -> dict[str, float]:
        """Score the model that looks at a window."""
        fit = train_shared(self.views(COEFFICIENTS), "sgplvm_window", self.seed)
        return self._spoken("sgplvm_window", fit, COEFFICIENTS, "A")

    def views(self, coefficients: int) -> xr.Dataset:
        """Return the training utterances as views."""
        return self.utterances.views(self.training, coefficients)

    def _spoken(self, name: str, fit: Fit, coefficients: int, start: Start) -> dict[str, float]:
        heard = self.utterances.views(self.test, coefficients)

        def speak() -> tuple[Faces, Faces]:
            face = audio_to_face(fit, heard, start=start)
            return self._by_utterance(face.means()), self._by_utterance(face.sds())

        speak()  # compiles
        return self.score(name, speak, float(fit.tree.attrs["seconds"]))

    def _by_utterance(self, made: np.ndarray) -> Faces:
        bounds = np.cumsum([len(self.true[name]) for name in self.test])[:-1]
        return dict(zip(self.test, np.split(made, bounds), strict=True))

    def voice_puppetry(self) -> dict[str, float]:
        """Score voice puppetry, which hears slopes too."""
        heard = {name: with_slopes(sound) for name, sound in self.utterances.sound.items()}
        training, test = (
            views_of({name: heard[name] for name in names},
                     {name: self.utterances.face[name] for name in names}, COORDINATES)
            for names in (self.training, self.test)
        )  # fmt: skip
        fit = train_puppetry(training, self.seed)
        return self.score(
            "voice_puppetry",
            lambda: (self._by_utterance(puppet_trajectory(fit, test)), None),
            float(fit.tree.attrs["seconds"]),
        )

    def ridge(self) -> dict[str, float]:
        """Score ridge regression."""
        return self._regression("ridge", train_ridge)

    def gp_regression(self) -> dict[str, float]:
        """Score Gaussian process regression."""
        return self._regression("gp_regression", train_regression)

    def _regression(self, name: str, learn: Callable[..., Any]) -> dict[str, float]:
        began = time.perf_counter()
        trained = learn(*self.plain)
        seconds = time.perf_counter() - began

        def speak() -> tuple[Faces, Faces | None]:
            sound = self.utterances.sound
            made = {one: trained.speak(sound[one][:, :PLAIN]) for one in self.test}
            if not isinstance(made[self.test[0]], tuple):
                return made, None
            return {n: m[0] for n, m in made.items()}, {n: m[1] for n, m in made.items()}

        return self.score(name, speak, seconds)


def reproduce(
    data: Path | None, out: Path, say: Say = print, seed: int = 0, repeats: int = REPEATS
) -> dict:
    """Train and test all models, and write ``speech.json`` and pictures to `out`.

    Parameters
    ----------
    data
        Folder that holds ``speech_ema/`` and ``grid/``; where None, BAYESMOTION_DATA.
    out
        Folder for the results and the fits.
    say
        Called with a line after every stage.
    seed
        Of the splits and of everything random.
    repeats
        Of the random split.
    """
    utterances = read_utterances(data)
    stages = Stages(out / "speech.json", plan(seed), say)
    stages.read(utterances=utterances.views(list(utterances.sound), COEFFICIENTS))
    stages.result |= {"utterances": utterances.count, "frames": utterances.frames}
    for number in range(repeats):
        repeat = Repeat(utterances, number, seed, stages.folder)
        works: dict[str, Callable[[], dict[str, float]]] = {
            "sgplvm_a": lambda r=repeat: r.shared("A"),
            "sgplvm_b": lambda r=repeat: r.shared("B"),
            "sgplvm_window": repeat.window,
            "voice_puppetry": repeat.voice_puppetry,
            "ridge": repeat.ridge,
            "gp_regression": repeat.gp_regression,
        }
        for name in MODELS:
            stages.do("repeats", str(number), name, work=works[name])
        stages.result |= together(stages.result["repeats"])
        write_json(stages.path, stages.result)
    draw_figures(stages.result, stages.folder / "tracks", out)
    _make_faces(stages, data, out, seed)
    return stages.result


def _make_faces(stages: Stages, data: Path | None, out: Path, seed: int) -> None:
    """Let the models make pictures: of the synthetic talker, and of real faces."""
    models, kept, say = trainers(seed), stages.folder, stages.say
    stages.do("talker", work=lambda: talker_results(out, kept / "talker", models, say))
    stages.do("grid", work=lambda: grid_results(data, out, kept / "grid", models, say))


def together(repeats: dict[str, dict[str, dict[str, float]]]) -> dict[str, Any]:
    """Sum up whole repeats: every model's scores, and differences between pairs."""
    whole = [one for one in repeats.values() if set(one) == set(MODELS)]
    rms = {name: [one[name]["rms_mm"] for one in whole] for name in MODELS}
    return {
        "count": len(whole),
        "ema": {name: summary([one[name] for one in whole]) for name in MODELS},
        "differences": {f"{a} - {b}": paired(rms[a], rms[b]) for a, b in PAIRS},
    }


def plan(seed: int) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "training": TRAINING,
        "test": TEST,
        "states": STATES,
        "steps": STEPS,
        "em_steps": EM_STEPS,
        "models": {name: describe_model(model) for name, model in PUBLISHED.items()},
        "voice_puppetry": describe_model(VoicePuppetry(STATES)),
        "coefficients": {"all": COEFFICIENTS, "plain": PLAIN},
        "talker": talker_plan(),
        "grid": grid_plan(),
        "seed": seed,
    }
