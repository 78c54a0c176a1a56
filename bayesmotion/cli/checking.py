"""The command ``check``."""

from pathlib import Path
from typing import Annotated

import typer

from .. import console
from ..errors import InputError
from .app import BAD_INPUT, Body, FrameRate

FOUND = 1


def check(
    files: Annotated[
        list[Path],
        typer.Argument(help="Recordings: .amc, .bvh, .mot, .npz, .c3d, .trc or a saved .nc."),
    ],
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Look recordings over: rest poses, jumps, frozen stretches, feet below the floor.

    Tells what was found and which frames to drop, file by file, and of several files a table
    at the end. The exit code is 1 if anything was found, 2 if a file cannot be read.
    """
    from ..motion.dataset import clips
    from ..motion.io.reading import read
    from ..motion.io.recordings import given, told
    from ..motion.quality.check import check as findings_of

    rows, code = [], 0
    for path in files:
        try:
            motion = read(path, **given(frame_rate=frame_rate, skeleton=skeleton))
        except InputError as reason:
            console.error(reason)
            rows.append((path, None, None, None, "refused"))
            code = BAD_INPUT
            continue
        findings = findings_of(motion)
        code = max(code, FOUND if findings else 0)
        if not findings:
            console.say(f"{path}: nothing found")
        for finding in findings:
            console.say(f"{path}: {told(finding)}")
        rate, frames = float(motion.attrs["frame_rate"]), motion.sizes["frame"]
        kinds = ", ".join(dict.fromkeys(finding.kind for finding in findings))
        rows.append((path, len(clips(motion)), frames, f"{rate:g}", kinds or "nothing found"))
    if len(files) > 1:
        console.table(
            f"{len(files)} files", ["file", "clips", "frames", "frames a second", "found"], rows
        )
    if code:
        raise typer.Exit(code)
