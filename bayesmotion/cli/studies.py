"""The commands ``demo`` and ``reproduce``."""

from pathlib import Path
from typing import Annotated

import typer

from .. import console
from ..errors import InputError
from ..files import FOLDER, write_json
from .outputs import Json, Open, opened, tell_saved

STUDIES = (
    "multifactor", "posterior", "keypose", "gait-pose", "voxel", "speech", "calibration",
    "denoising", "gaps", "gait-questions", "cmu35", "gpode", "cmu-mm", "pace",
)  # fmt: skip


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the files."), FOLDER] = Path(
        "bayesmotion-demo"
    ),
    show: Open = False,
    json_file: Json = None,
) -> None:
    """Show the main job on synthetic walkers: no data, no network, about a minute.

    Three people were recorded in three gaits, but for one clip. The model learns from the
    eight clips, makes the ninth, and forecasts it from its beginning: demo.html shows that
    moving.
    """
    console.note("loading")
    from ..studies import demo as study

    console.note("learning from eight clips of three people in three gaits")
    with console.progress("fit", study.STEPS) as progress:
        shown = study.run(out, progress=progress)
    missing = "-".join(study.MISSING.values())
    ordered = sorted(shown.distances.items(), key=lambda item: item[1])
    console.table(
        f"Distance to the true {missing}, which was not recorded",
        ["clip", "radians"],
        ordered,
    )
    answer = "is closer than every" if shown.closest else "is not closer than every"
    console.say(f"the synthesised clip {answer} recorded one\n")
    console.table(
        f"Mean error of {study.HORIZON} frames of it, forecast from {study.CONTEXT}",
        ["", "radians"],
        list(shown.errors.items()),
    )
    console.say("")
    if json_file is not None:
        write_json(json_file, {"distances": dict(ordered), "errors": dict(shown.errors),
                               "files": [str(path) for path in shown.files]})  # fmt: skip
    tell_saved(*shown.files, json_file)
    console.say(f"{sum(shown.seconds.values()):.0f} seconds")
    opened(out / study.PAGE, show)


def reproduce(
    study: Annotated[str, typer.Argument(help=f"The study: {', '.join(STUDIES)}.")],
    out: Annotated[Path, typer.Option(help="Folder for tables and pictures."), FOLDER],
    data: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the recordings; by default BAYESMOTION_DATA. CMU's are downloaded "
            "where they are in neither."
        ),
    ] = None,
    json_file: Json = None,
) -> None:
    """Repeat a published study and set its numbers beside ours."""
    if study not in STUDIES:
        raise InputError(repr(study), "there is no such study", f"Use {', '.join(STUDIES)}")
    import importlib

    module = importlib.import_module(f"bayesmotion.studies.{study.replace('-', '_')}.study")
    if data is not None and not data.is_dir():
        raise InputError(data, "there is no such folder", "Give the folder of the recordings")
    module.reproduce(data, out, console.note)
    if json_file is not None:
        files = sorted(str(path) for path in out.rglob("*") if path.is_file())
        write_json(json_file, {"study": study, "files": files})
    tell_saved(out, json_file)
