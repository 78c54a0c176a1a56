"""The command ``fit speech``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import console
from ..errors import InputError
from .app import fits
from .fit_options import Out, Seed, known_of, refuse_silent
from .predicting import tell_saved

if TYPE_CHECKING:
    import xarray as xr

STEPS, RATE = 60, 25.0


@fits.command("speech")
def fit_speech(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Sound or video files, each with its tracks beside it: a csv file of the same "
            "name, a line of names and a line a frame. Or one saved .nc of views."
        ),
    ],
    out: Out,
    model: Annotated[
        str,
        typer.Option(
            help="sgplvm, the shared GPLVM of the paper; sgplvm_window, which sees a window of "
            "sound; voice_puppetry, a chain of facial states."
        ),
    ] = "sgplvm_window",
    rate: Annotated[
        float | None, typer.Option(help=f"Frames a second of the tracks; {RATE:g}.")
    ] = None,
    coefficients: Annotated[
        int | None,
        typer.Option(
            min=2,
            max=40,
            help="Cepstral coefficients of the sound; 13 with sgplvm, else 20.",
        ),
    ] = None,
    states: Annotated[int | None, typer.Option(min=1, help="States of voice_puppetry; 20.")] = None,
    max_steps: Annotated[
        int, typer.Option(min=1, help="At most so many steps of the search.")
    ] = STEPS,
    seed: Seed = 0,
) -> None:
    """Learn a face, or any other tracks, from speech."""
    from ..inference.methods import EM, MAP, fit
    from ..models.shared_gplvm.published import PUBLISHED, published
    from ..models.voice_puppetry import VoicePuppetry
    from ..sensing.views import read_views

    known_of("model", model, (*PUBLISHED, VoicePuppetry.name))
    if model != VoicePuppetry.name:
        refuse_silent(f"to {model}", states=states)
    if [path.suffix for path in files] == [".nc"]:
        refuse_silent("to saved views", rate=rate, coefficients=coefficients)
        if not files[0].is_file():
            raise InputError(files[0], "there is no such file", "Check the path of the views")
        views = _stored_views(files[0])
    else:
        count = coefficients or (13 if model == "sgplvm" else 20)
        views = read_views(files, frame_rate=RATE if rate is None else rate, coefficients=count)
    with console.progress("fit", max_steps) as progress:
        if model == VoicePuppetry.name:
            program, method = VoicePuppetry(states or 20), EM(max_steps=max_steps)
        else:
            program = published(model, views["audio"].shape[1])
            method = MAP(initial=1, keep=1, max_steps=max_steps)
        found = fit(program, views, method=method, seed=seed, progress=progress)
    found.save(out)
    clips, frames = len(set(views["clip"].values.tolist())), views.sizes["frame"]
    console.say(f"{clips} clips, {frames} frames; log density {found.stats()['lp']:.1f}")
    tell_saved(out)


def _stored_views(path: Path) -> "xr.Dataset":
    """Read views that were saved."""
    import xarray as xr

    mend = "Save views made by bayesmotion.sensing.views.views_of"
    try:
        with xr.open_dataset(path, engine="h5netcdf") as stored:
            views = stored.load()
    except (OSError, ValueError) as error:
        raise InputError(path, "it cannot be read as netCDF", mend) from error
    if not {"audio", "face"} <= set(views.data_vars):
        raise InputError(path, "it holds no views audio and face", mend)
    return views
