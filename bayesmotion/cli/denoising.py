"""The commands ``denoise`` and ``fill-gaps``: recordings made better by themselves."""

from pathlib import Path
from typing import Annotated

import typer

from .. import console
from ..files import MARKERS, RECORDING, TABLE
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


def fill_gaps(
    clip: Annotated[Path, typer.Argument(help="A recording of markers, of one clip.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Write the whole recording: .c3d, .trc or .nc."),
        MARKERS,
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(help="Write mean, sd and quantiles by time and coordinate: .csv or .nc."),
        TABLE,
    ] = None,
    json_file: Json = None,
    frame_rate: FrameRate = None,
) -> None:
    """Fill in the gaps of markers from those that are seen: no fit is needed.

    Gaps of joint angles are filled in by denoise --noise 0.
    """
    import numpy as np

    from ..files import write_json
    from ..motion.dataset import clips
    from ..motion.io.reading import write
    from ..motion.io.recordings import read_clip
    from ..tasks.gaps import fill_gaps as filled
    from ..tasks.outcome import LENGTHS

    recorded = read_clip(clip, frame_rate=frame_rate)
    made = filled(recorded)
    rate, names = float(recorded.attrs["frame_rate"]), recorded["joint"].values
    rows = [
        {
            "marker": str(names[gap.marker]), "first_frame": int(gap.frames[0]),
            "frames": len(gap.frames), "seconds": len(gap.frames) / rate,
            "sd": float(np.sqrt(np.mean(gap.sds**2))),
        }
        for gap in made.gaps
    ]  # fmt: skip
    metres = recorded.attrs.get("metres")
    unit = "length unit" if metres is None else LENGTHS.get(metres, f"{metres:.4g} m")
    if rows:
        console.table(
            "Gaps that were filled in", ["marker", "first frame", "frames", f"sd ({unit})"],
            [(row["marker"], row["first_frame"], row["frames"], row["sd"]) for row in rows],
        )  # fmt: skip
    else:
        console.say("there are no gaps")
    if out is not None:
        write(made.motion, out)
    if table is not None:
        write(made, table)
    if json_file is not None:
        write_json(json_file, {
            "clip": clips(recorded)[0], "frames": recorded.sizes["frame"], "unit": unit,
            "gaps": rows, "messages": list(made.messages),
        })  # fmt: skip
    tell_saved(out, table, json_file)
