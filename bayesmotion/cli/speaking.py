"""The command ``speak``: the face of a sound file, as tracks and as a video."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from .. import console
from ..errors import InputError
from ..files import TRACKS, VIDEO

if TYPE_CHECKING:
    from ..tasks.speech import Start


def speak(
    fit: Annotated[Path, typer.Argument(help="A fit of a model of speech.")],
    sound: Annotated[Path, typer.Argument(help="A file with sound.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Write a video with the sound, .mp4; needs --portrait."),
        VIDEO,
    ] = None,
    portrait: Annotated[
        Path | None, typer.Option(help="Whose face: .npz, as `bayesmotion portrait` wrote it.")
    ] = None,
    tracks: Annotated[
        Path | None,
        typer.Option(help="Write the face's tracks, .csv; by default beside the video."),
        TRACKS,
    ] = None,
    draws: Annotated[int, typer.Option(min=1, help="At most so many draws of the fit.")] = 100,
    start: Annotated[
        str | None,
        typer.Option(
            help="Of the shared model: A or B, the paper's starts of the search for a path; "
            "else all that are found count."
        ),
    ] = None,
) -> None:
    """Make a face of sound alone.

    Tracks are what the model was fitted to, a frame a line, and their standard deviations.
    """
    from ..fit import load
    from ..sensing.audio.cepstra import read_audio
    from ..sensing.face.files import load_portrait
    from ..tasks.speech_files import speak_file, write_tracks

    if out is None and tracks is None:
        raise InputError("speak", "there is nothing to write", "Give --out or --tracks")
    if out is not None and portrait is None:
        raise InputError(
            "--out", "a video needs a face", "Give --portrait, or --tracks alone without a video"
        )
    if start not in (None, "A", "B"):
        raise InputError(f"--start {start!r}", "there is no such start", "Use A or B")
    written = tracks if tracks is not None or out is None else out.with_suffix(".csv")
    assert written is not None
    TRACKS.check(written, [fit, sound, *([] if portrait is None else [portrait])])
    whose = None if portrait is None else load_portrait(portrait)
    trained = load(fit)
    made = speak_file(trained, sound, draws=draws, start=cast("Start | None", start))
    if whose is not None and list(map(str, made["coordinate"].values)) != whose.names:
        raise InputError(
            portrait, "the fit's tracks are not its parameters", "Give the portrait of the fit"
        )
    rate = float(made.attrs["frame_rate"])
    if whose is not None and abs(whose.frame_rate - rate) > 1e-3:
        raise InputError(
            portrait,
            f"it has {whose.frame_rate:g} frames a second, the fit {rate:g}",
            "Fit with --rate of the videos",
        )
    write_tracks(made, written)
    if out is not None and whose is not None:
        whose.write_film(out, made["face"].values, *read_audio(sound))
        console.say(f"saved to {out}")
    console.say(f"saved to {written}")
