"""The speech study on the synthetic talker, whose landmarks are known exactly.

What a face made from sound loses against the truth is set beside what the appearance model
itself loses when it encodes the true pictures: a model of speech cannot do better than that.
"""

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...sensing.audio.cepstra import mfcc
from ...sensing.face.appearance import fit_appearance
from ...sensing.face.talker import RATE, Utterance, synthetic_talker
from ...sensing.face.talker_face import INNER_LIPS, OUTER_LIPS
from ..stages import Say
from .faces import Lips, Talk, compared, spoken
from .models import COEFFICIENTS, Train
from .pictures import faces_figure, openings_figure

SEED = 0
TRAINING, TESTS = 20, 4  # sentences
LIPS = Lips(
    slice(OUTER_LIPS.start, INNER_LIPS.stop), upper=INNER_LIPS.start + 2, lower=INNER_LIPS.start + 6
)


def talker_plan() -> dict[str, int]:
    """The settings of this part of the study."""
    return {"seed": SEED, "training": TRAINING, "tests": TESTS}


def talker_results(
    out: Path,
    kept: Path,
    models: Mapping[str, Train],
    say: Say = print,
    *,
    training: int = TRAINING,
    tests: int = TESTS,
) -> dict:
    """Make the faces of sentences of the synthetic talker from their sound, and draw them.

    Parameters
    ----------
    out
        Folder for pictures.
    kept
        Folder for what models made, which is not made again; of the same settings and models.
    models
        What makes faces from sound.
    say
        Called with a line after every stage.
    training, tests
        Numbers of sentences.
    """
    from ...plots import save

    began = time.perf_counter()
    said = synthetic_talker(SEED, utterances=training + tests)
    talks = [_talk(f"sentence_{number}", one) for number, one in enumerate(said)]
    say(f"talker: {len(said)} sentences in {time.perf_counter() - began:.0f} s")
    learned, rest = talks[:training], talks[training:]
    model = fit_appearance(
        np.concatenate([talk.frames for talk in learned]),
        np.concatenate([talk.landmarks for talk in learned]),
    )
    face = {"talker": model}
    made = spoken(learned, rest, face, models, kept, say)
    rows = compared(rest, made, face, LIPS)
    for row in rows.values():
        row["times_encoder"] = row["landmarks_px"] / rows["encoder"]["landmarks_px"]
    first = rest[0]
    tracks = {"encoded": model.encode(first.frames, first.landmarks)}
    tracks |= {name: one[0] for name, one in made.items()}
    chosen = np.linspace(10, len(first.frames) - 15, 8).astype(int)
    poses = model.poses(first.landmarks)[chosen]
    ground = np.full(first.frames.shape[1:], 128.0)
    drawn = {name: model.render(track[chosen], poses, ground) for name, track in tracks.items()}
    pictures = {"true": first.frames[chosen].astype(float), **drawn}
    save(faces_figure(pictures, first.landmarks[chosen]), out / "talker_faces.png")
    shapes = {name: model.decode(track)[0] for name, track in tracks.items()}
    save(openings_figure(shapes, LIPS, said[0].frame_rate), out / "talker_lips.png")
    return {
        "seed": SEED,
        "training_frames": sum(len(talk.frames) for talk in learned),
        "test_frames": sum(len(talk.frames) for talk in rest),
        "parameters": int(model.basis.shape[1]),
        "kept": list(model.kept),
        "models": rows,
    }


def _talk(name: str, said: Utterance) -> Talk:
    """Hear a sentence."""
    sound = mfcc(said.wave, RATE, said.frame_rate, COEFFICIENTS)
    return Talk(name, "talker", sound, said.frames, said.landmarks)
