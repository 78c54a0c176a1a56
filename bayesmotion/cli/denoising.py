"""The command ``denoise``: a recording without its noise, by itself."""

from pathlib import Path
from typing import Annotated

import typer

from .. import console
from ..files import RECORDING, TABLE
from .app import Body, FrameRate
from .outputs import Json, Picture, tell_saved


def denoise(
    clip: Annotated[Path, typer.Argument(help="A recording with joint angles, of one clip.")],
    noise: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Standard deviation of the angles' noise in degrees; estimated if not given. "
            "With 0 gaps alone are filled in.",
        ),
    ] = None,
    root_noise: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="That of the root's path, in the recording's length unit; its path stays as it "
            "is if not given.",
        ),
    ] = 0.0,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the recording without its noise: .bvh or .nc."),
        RECORDING,
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(help="Write mean, sd and quantiles by time and channel: .csv or .nc."),
        TABLE,
    ] = None,
    json_file: Json = None,
    plot: Picture = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Take the noise out of a recording: no fit is needed.

    The recording comes back with its frames, rate and skeleton. What is missing of it (NaN) is
    filled in. By a fit of gait cycles see filter and reconstruct.
    """
    from ..files import write_json
    from ..motion.dataset import clips
    from ..motion.io.reading import write
    from ..motion.io.recordings import read_clip
    from ..tasks.denoise import denoise as denoise_of

    recorded = read_clip(clip, frame_rate=frame_rate, skeleton=skeleton)
    made = denoise_of(recorded, noise_degrees=noise, root_noise=root_noise)
    known = "estimated" if made.estimated else "given"
    console.say(f"noise of {made.noise_degrees:.3g} degrees ({known})")
    console.say(f"the 90 % interval of an angle is {made.width90_degrees:.2g} degrees wide")
    if made.filled.any():
        console.say(f"{int(made.filled.sum())} missing angles were filled in")
    if out is not None:
        write(made.motion, out)
    if table is not None:
        write(made, table)
    if json_file is not None:
        write_json(json_file, {
            "clip": clips(recorded)[0], "frames": recorded.sizes["frame"],
            "noise_degrees": made.noise_degrees, "estimated": made.estimated,
            "width90_degrees": made.width90_degrees, "filled": int(made.filled.sum()),
            "messages": list(made.messages),
        })  # fmt: skip
    if plot is not None:
        from ..plots import compare, save

        save(compare({"given": recorded, "denoised": made.motion}), plot)
    tell_saved(out, table, json_file, plot)
