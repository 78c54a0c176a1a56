"""The command ``bench``: what computations cost on this machine."""

from pathlib import Path
from typing import Annotated

import typer

from .. import console
from ..errors import InputError
from ..files import JSON
from .outputs import tell_saved


def bench(
    out: Annotated[Path, typer.Option(help="Write what is measured as JSON."), JSON],
    part: Annotated[
        list[str] | None,
        typer.Option(help="Measure this part alone, several times for several; by default all."),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Runs that medians are of.")] = 7,
) -> None:
    """Measure what densities and starting cost on this machine.

    What is in the file already, of the same settings, is not measured again.
    """
    from ..benchmarks.bench import PARTS
    from ..benchmarks.bench import bench as measure

    for name in part or ():
        if name not in PARTS:
            raise InputError(f"--part {name}", "there is no such part", f"Use {', '.join(PARTS)}")
    measure(out, parts=part or PARTS, repeats=repeats, say=console.note)
    tell_saved(out)
