"""The command ``fit tensor``."""

from typing import Annotated

import typer

from ..errors import InputError
from .app import fits
from .fit_options import (
    MAP_STEPS,
    Drop,
    Files,
    Filter,
    Labels,
    Out,
    Rate,
    Seed,
    known_of,
    run_of,
)

CHANNELS = ("positions", "rotations", "both")
BODIES = ("one", "own")
PACES = ("time", "path")


@fits.command("tensor")
def fit_tensor(
    files: Files,
    out: Out,
    labels: Labels = None,
    channels: Annotated[
        str, typer.Option(help=f"What is seen of a pose: {', '.join(CHANNELS)}.")
    ] = "both",
    coefficients: Annotated[
        int, typer.Option(min=1, help="Of the cosine transform in time; the first is the mean.")
    ] = 3,
    rank: Annotated[
        int | None, typer.Option(min=1, help="Columns of the position mode; all.")
    ] = None,
    static: Annotated[
        bool, typer.Option("--static/--movement", help="Keep the mean pose, or movement only.")
    ] = True,
    body: Annotated[str, typer.Option(help="All clips on one body, or each on its own.")] = "one",
    pace: Annotated[str, typer.Option(help="Clips aligned by time, or by the path gone.")] = "time",
    factors: Annotated[
        str | None,
        typer.Option(help="Modes beside position, with commas: subject,task. By default all."),
    ] = None,
    rate: Rate = 30.0,
    filter: Filter = "none",
    seed: Seed = 0,
    starts: Annotated[
        int | None, typer.Option(min=1, help="Starting points of the search; 4.")
    ] = None,
    max_steps: Annotated[
        int | None, typer.Option(min=1, help=f"At most so many steps; {MAP_STEPS}.")
    ] = None,
    drop: Drop = False,
) -> None:
    """Fit whole segments: who moves and what they do, for `recognize`.

    Every file is one segment that shows one task; the factors, such as subject and task, are
    the modes of the tensor beside position.
    """
    known_of("kind of channels", channels, CHANNELS)
    known_of("kind of body", body, BODIES)
    known_of("pace", pace, PACES)
    run = run_of(out, "map", seed, False, starts=starts, max_steps=max_steps, mass=None, start=None)
    from ..models.multifactor_tensor import MultifactorTensor
    from ..motion.io import read
    from ..motion.recordings import at_rate, looked_over
    from .fitting import factors_of, fitted

    motion = looked_over(read(*files, labels=labels), dropping=drop)
    motion = at_rate(motion, rate, filter)
    names = factors_of(factors, motion, labels)
    if len(names) < 2:
        raise InputError("--factors", "the tensor needs two or more", "Write subject,task")
    preparation = {
        "channels": channels,
        "coefficients": coefficients,
        "static": static,
        "body": body,
        "pace": pace,
    }
    fitted(MultifactorTensor(tuple(names), rank), motion, run, out, filter, preparation)
