"""The command ``view``: motions seen moving, on one page."""

from pathlib import Path
from typing import Annotated

import typer

from ..files import PAGE
from .app import Body, FrameRate
from .outputs import Json, Open, opened, tell_saved


def view(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Recordings (.bvh, .amc, .c3d, .trc, ...), voxels, or fits, whose clips are shown."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Where the page is written."), PAGE] = Path(
        "player.html"
    ),
    truth: Annotated[
        Path | None, typer.Option(help="A recording of what really happened, laid under the first.")
    ] = None,
    arrangement: Annotated[
        str | None, typer.Option(help="overlaid, or beside each other; the page can change it.")
    ] = None,
    sound: Annotated[
        Path | None, typer.Option(help="A sound file that is heard in step with the motion.")
    ] = None,
    sound_start: Annotated[
        float, typer.Option(min=0.0, help="The second of the sound at which the motion begins.")
    ] = 0.0,
    show: Open = False,
    json_file: Json = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Show motions moving, in three dimensions, on one page that needs no network.

    Of a forecast with its draws: forecast --view.
    """
    from ..files import FIT, VOXELS, write_json
    from ..motion.io.reading import read
    from ..motion.io.recordings import given
    from ..view.viewer import view as view_of

    options = given(frame_rate=frame_rate, skeleton=skeleton)
    what = [
        path if any(kind.holds(path) for kind in (FIT, VOXELS)) else read(path, **options)
        for path in files
    ]
    real = None if truth is None else read(truth, **options)
    page = view_of(*what, truth=real, arrangement=arrangement, sound=sound, sound_start=sound_start)
    page.write(out)
    if json_file is not None:
        scene = page.scene
        write_json(json_file, {
            "file": str(out), "bodies": [track.name for track in scene.tracks],
            "clouds": [cloud.name for cloud in scene.clouds], "messages": list(scene.messages),
        })  # fmt: skip
    tell_saved(out, json_file)
    opened(out, show)
