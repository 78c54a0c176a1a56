"""The command ``portrait``: videos of a person made into tracks and a face to film with."""

from pathlib import Path
from typing import Annotated

import typer

from .. import console
from ..files import PARAMETERS, PORTRAIT, check_outputs, write_json
from .outputs import Json, tell_saved


def portrait(
    videos: Annotated[list[Path], typer.Argument(help="Videos of one person, head and face.")],
    out: Annotated[Path, typer.Option(help="The portrait, .npz."), PORTRAIT],
    keep: Annotated[float, typer.Option(help="Share of the variance that is kept.")] = 0.95,
    scale: Annotated[float, typer.Option(help="Texture pixels a pixel of the video.")] = 1.0,
    json_file: Json = None,
) -> None:
    """Fit an appearance model to videos; write their parameters beside them as csv.

    Landmarks are read from NAME.landmarks.csv or .npz beside NAME.mp4, or tracked, which
    needs the extra `face`. `fit shared-gplvm` takes the same videos, `speak` the portrait.
    """
    from ..tasks.portraits import make_portrait, write_parameters

    check_outputs([(path.with_suffix(".csv"), PARAMETERS) for path in videos], videos)
    made, tracks = make_portrait(videos, keep=keep, scale=scale, say=console.note)
    written = [
        write_parameters(path.with_suffix(".csv"), made.names, tracks[path.stem]) for path in videos
    ]
    made.save(out)
    shape, texture, both = made.model.kept
    console.say(
        f"{len(made.names)} parameters keep {both:.1%} of the variance (shape {shape:.1%}, "
        f"texture {texture:.1%})"
    )
    if json_file is not None:
        kept = {"both": both, "shape": shape, "texture": texture}
        files = [str(path) for path in (*written, out)]
        write_json(json_file, {"parameters": list(made.names), "kept": kept, "files": files})
    tell_saved(*written, out, json_file)
