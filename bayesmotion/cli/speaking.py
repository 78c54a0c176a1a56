"""The command ``speak``: the face of a sound file, as tracks and as a video."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from ..errors import InputError
from ..files import FACE, TRACKS, VIDEO
from .outputs import Json, Most, tell_saved

if TYPE_CHECKING:
    from ..tasks.speech import Start


def speak(
    fit: Annotated[Path, typer.Argument(help="A fit of a model of speech.")],
    sound: Annotated[Path, typer.Argument(help="A file with sound.")],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write a video with the sound, .mp4; needs --portrait. As .csv or .nc: mean, sd "
            "and quantiles by time and track."
        ),
        FACE,
    ] = None,
    portrait: Annotated[
        Path | None, typer.Option(help="Whose face: .npz, as `bayesmotion portrait` wrote it.")
    ] = None,
    tracks: Annotated[
        Path | None,
        typer.Option(help="Write the face's tracks, .csv; by default beside the video."),
        TRACKS,
    ] = None,
    most: Most = 100,
    start: Annotated[
        str | None,
        typer.Option(
            help="Of the shared model: A or B, the paper's starts of the search for a path; "
            "else all that are found count."
        ),
    ] = None,
    json_file: Json = None,
) -> None:
    """Make a face of sound alone.

    Tracks are what the model was fitted to, a frame a line, and their standard deviations.
    """
    from ..files import write_json
    from ..fit import load
    from ..motion.io.tables import write_table
    from ..sensing.audio.cepstra import read_audio
    from ..sensing.face.files import load_portrait
    from ..tasks.speech_files import speak_file, write_tracks

    if out is None and tracks is None:
        raise InputError("speak", "there is nothing to write", "Give --out or --tracks")
    table = None if out is None or out.suffix.lower() in VIDEO.suffixes else out
    if table is not None:
        out = None
    if out is not None and portrait is None:
        raise InputError(
            "--out", "a video needs a face", "Give --portrait, or --tracks alone without a video"
        )
    if start not in (None, "A", "B"):
        raise InputError(f"--start {start!r}", "there is no such start", "Use A or B")
    written = tracks if tracks is not None or out is None else out.with_suffix(".csv")
    if written is not None:
        TRACKS.check(written, [fit, sound, *([] if portrait is None else [portrait])])
    whose = None if portrait is None else load_portrait(portrait)
    trained = load(fit)
    made = speak_file(trained, sound, draws=most, start=cast("Start | None", start))
    if whose is not None and list(map(str, made["channel"].values)) != whose.names:
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
    if written is not None:
        write_tracks(made, written)
    if table is not None:
        write_table(made, table)
    if out is not None and whose is not None:
        whose.write_film(out, made["mean"].values, *read_audio(sound))
    if json_file is not None:
        files = [str(path) for path in (out, written, table) if path is not None]
        content = {"sound": str(sound), "frames": made.sizes["frame"], "frame_rate": rate,
                   "tracks": made["channel"].values.tolist(),
                   "mean_sd": made["sd"].mean("frame").values.tolist(), "files": files}  # fmt: skip
        write_json(json_file, content)
    tell_saved(out, written, table, json_file)
