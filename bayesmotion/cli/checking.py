"""The command ``check``."""

from pathlib import Path
from typing import Annotated

import typer

from .. import console


def check(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings: .amc, .bvh, .c3d or a saved .nc.")
    ],
) -> None:
    """Look recordings over: rest poses, jumps, frozen stretches, feet below the floor.

    Tells what was found and which frames to drop. The exit code is 1 if anything was found.
    """
    from ..motion.io.reading import read
    from ..motion.io.recordings import told
    from ..motion.quality.check import check as findings_of

    count = 0
    for path in files:
        findings = findings_of(read(path))
        count += len(findings)
        if not findings:
            console.say(f"{path}: nothing found")
        for finding in findings:
            console.say(f"{path}: {told(finding)}")
    if count:
        raise typer.Exit(1)
