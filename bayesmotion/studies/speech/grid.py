"""The speech study on real faces: clips of the GRID corpus (Cooke et al. 2006, CC BY 4.0).

From video to landmarks (tracker), to an appearance model of every clip's first part, to
faces made again in its last part; then one clip is left out whole, and its face is made
from its sound by models that learned from all others, another clip of the same speaker
among them. With ten clips of three seconds this shows that the path works, not how well a
face can be made from speech.

Of sound the mean of the clip is taken off, since speakers and microphones differ; of faces
that of the person (`sensing.face.appearance`). Tracked landmarks stand for the truth.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...files import write_json
from ...motion.datasets.fetching import folders
from ...sensing.audio.cepstra import mfcc, read_audio
from ...sensing.face.appearance import AppearanceModel, fit_appearance
from ...sensing.face.landmarks import read_landmarks, track_landmarks, write_landmarks
from ...sensing.face.search import train_search
from ...sensing.face.video import read_video, write_video
from ..stages import Say
from .faces import Lips, Talk, compared, spoken
from .models import COEFFICIENTS, Train
from .pictures import faces_figure, openings_figure

CLIPS = (
    "bbaf2n", "brbk7n", "id2_vcd_swwp2s", "lbax4n", "lrwp9a",
    "lwbsza", "pwij3p", "sbia1a", "sbwe5n", "swiz3n",
)  # fmt: skip
LEFT_OUT, SAME_SPEAKER = "id2_vcd_swwp2s", "pwij3p"
LIPS = Lips(slice(48, 68), upper=62, lower=66)  # of the tracker's 68 landmarks
FIRST = 50  # frames of a clip that its own appearance model is fitted to
DISPLACED = 8.0  # pixels from the truth at which searches start
SEED = 0


def grid_plan() -> dict[str, Any]:
    """The settings of this part of the study."""
    return {
        "clips": list(CLIPS),
        "left_out": LEFT_OUT,
        "same_speaker": SAME_SPEAKER,
        "first_frames": FIRST,
        "displaced_px": DISPLACED,
        "seed": SEED,
    }


def grid_results(
    data: Path | None, out: Path, kept: Path, models: Mapping[str, Train], say: Say = print
) -> dict:
    """Track, model, make faces from sound, and draw them into `out`.

    Parameters
    ----------
    data
        Folder that holds ``grid/``; by default ``$BAYESMOTION_DATA``.
    out
        Folder for pictures and a video.
    kept
        Folder for landmarks and what models made, which are not made again; of the same settings
        and models.
    models
        What makes faces from sound.
    say
        Called with a line after every stage.

    Raises
    ------
    InputError
        If a clip is not there, or the tracker is not installed.
    """
    talks = {name: _talk(name, data, kept, say) for name in CLIPS}
    result: dict = {"settings": {"first_frames": FIRST, "displaced_px": DISPLACED, "seed": SEED}}
    result["clips"] = {name: _remade(talk, kept, say) for name, talk in talks.items()}
    training = [talk for name, talk in talks.items() if name != LEFT_OUT]
    test = talks[LEFT_OUT]
    model = fit_appearance(
        np.concatenate([talk.frames for talk in training]),
        np.concatenate([talk.landmarks for talk in training]),
        person=[talk.person for talk in training for _ in talk.frames],
    )
    people = {talk.person: model.of(talk.frames, talk.landmarks) for talk in training}
    made = spoken(training, [test], people, models, kept / "left_out", say)
    result["left_out"] = {
        "clip": LEFT_OUT,
        "same_speaker": SAME_SPEAKER,
        "training_frames": sum(len(talk.frames) for talk in training),
        "parameters": model.basis.shape[1],
        "models": compared([test], made, people, LIPS),
    }
    _draw(test, talks[SAME_SPEAKER], made, people[test.person], data, out)
    say("grid: the clip that was left out has been made")
    return result


def grid_file(name: str, data: Path | None) -> Path:
    """Find the video of a clip.

    Raises
    ------
    InputError
        If it is in none of the folders.
    """
    for folder in folders("grid", None if data is None else data / "grid"):
        path = folder / f"{name}.mpg"
        if path.is_file():
            return path
    raise InputError(
        f"{name}.mpg", "the clip is not there", "Get it from the GRID corpus, and give its folder"
    )


def _talk(name: str, data: Path | None, kept: Path, say: Say) -> Talk:
    """Read a clip: its pictures, landmarks and sound."""
    path, tracked = grid_file(name, data), kept / f"{name}.npz"
    video = read_video(path)
    if not tracked.is_file():
        write_landmarks(tracked, track_landmarks(video.frames))
        say(f"grid: tracked {name}")
    landmarks = read_landmarks(tracked)
    wave, rate = read_audio(path)
    sound = mfcc(wave, rate, video.frame_rate, COEFFICIENTS)
    count = min(len(sound), len(video.frames))
    sound = sound[:count] - sound[:count].mean(axis=0)
    # The two clips of one speaker; the others' names do not matter.
    person = SAME_SPEAKER if name == LEFT_OUT else name
    return Talk(name, person, sound, video.frames[:count], landmarks[:count])


def _remade(talk: Talk, kept: Path, say: Say) -> dict[str, float | int]:
    """Fit a model to the first part of a clip; make the rest again, and search in it."""
    path = kept / f"{talk.name}_remade.json"
    if path.is_file():
        return json.loads(path.read_text(encoding="utf-8"))
    model = fit_appearance(talk.frames[:FIRST], talk.landmarks[:FIRST])
    rest, true = talk.frames[FIRST:], talk.landmarks[FIRST:]
    parameters = model.encode(rest, true)
    decoded = model.decode(parameters)[1]
    taken = model.textures(rest, true)
    search = train_search(
        model, talk.frames[:FIRST:2], talk.landmarks[:FIRST:2], seed=SEED, displacement=DISPLACED
    )
    angle = np.random.default_rng(SEED).uniform(0.0, 2 * np.pi, size=len(rest))
    starts = true + DISPLACED * np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, None]
    found = [search(frame, start) for frame, start in zip(rest, starts, strict=True)]
    landmarks = np.stack([one.landmarks for one in found])
    again = model.landmarks(parameters, model.poses(true))
    result = {
        "parameters": int(model.basis.shape[1]),
        "shape_kept": model.kept[0],
        "texture_kept": model.kept[1],
        "combined_kept": model.kept[2],
        "grey_levels": float(np.sqrt(np.mean((taken - decoded) ** 2))),
        "grey_levels_mean_face": float(np.sqrt(np.mean((taken - model.mean_texture) ** 2))),
        "landmarks_px": _distance(again, true),
        "search_px": _distance(landmarks, true),
        "search_failed": sum(bool(one.failure) for one in found),
        "frames": len(rest),
    }
    write_json(path, result)
    say(f"grid: made {talk.name} again")
    return result


def _distance(landmarks: np.ndarray, true: np.ndarray) -> float:
    return float(np.sqrt(((landmarks - true) ** 2).sum(axis=-1).mean()))


def _draw(
    test: Talk,
    other: Talk,
    made: Mapping[str, list[np.ndarray]],
    model: AppearanceModel,
    data: Path | None,
    out: Path,
) -> None:
    """Draw the left-out clip as it was, as it is encoded and as models made it; film one."""
    from ...plots import save

    poses = model.poses(test.landmarks)
    encoded = model.encode(test.frames, test.landmarks)
    rows = {"recorded": test.frames.astype(float)}
    tracks = {"encoded": encoded, **{name: one[0] for name, one in made.items()}}
    opened = test.landmarks[:, LIPS.lower, 1] - test.landmarks[:, LIPS.upper, 1]
    # Frames at even ranks of the mouth's opening, so that all mouths are seen.
    chosen = np.sort(np.argsort(opened)[np.linspace(0, len(opened) - 1, 8).astype(int)])
    for name, track in tracks.items():
        shown = [
            model.render(track[k : k + 1], poses[k : k + 1], test.frames[k])[0] for k in chosen
        ]
        rows[name] = np.stack(shown)
    rows["recorded"] = rows["recorded"][chosen]
    save(faces_figure(rows, test.landmarks[chosen]), out / "grid_faces.png")
    shapes = {name: model.decode(track)[0] for name, track in tracks.items()}
    save(openings_figure(shapes, LIPS, 25.0), out / "grid_lips.png")
    wave, rate = read_audio(grid_file(test.name, data))
    pose = model.poses(other.landmarks[:1])[0]
    for name, one in made.items():
        film = model.render(one[0], pose, other.frames[0])
        write_video(out / f"grid_{name}.mp4", film, 25.0, wave, rate)
