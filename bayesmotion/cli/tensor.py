"""The command ``fit motion_tensor``."""

from typing import TYPE_CHECKING, Annotated, cast

import typer

from ..errors import InputError
from .app import fits
from .fit_options import (
    Chains,
    Draws,
    Drop,
    Files,
    Filter,
    Labels,
    Mass,
    MaxSteps,
    Method,
    Out,
    Rate,
    Resume,
    Seed,
    Start,
    Starts,
    TreeDepth,
    Walkers,
    Warmup,
    known_of,
    run_of,
)

if TYPE_CHECKING:
    from ..motion.segments import Body, Channels, Pace

CHANNELS = ("positions", "rotations", "both")
BODIES = ("one", "own")
PACES = ("time", "path")


@fits.command("motion_tensor")
def fit_motion_tensor(
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
    effect_sd: Annotated[
        float,
        typer.Option(
            min=0.01, help="Prior of people and tasks, in deviations of cells and repetitions."
        ),
    ] = 10.0,
    samples: Annotated[
        int, typer.Option(min=2, help="Of a clip, before the cosine transform.")
    ] = 64,
    method: Method = "map",
    rate: Rate = 30.0,
    filter: Filter = "none",
    seed: Seed = 0,
    starts: Starts = None,
    max_steps: MaxSteps = None,
    warmup: Warmup = None,
    draws: Draws = None,
    chains: Chains = None,
    mass: Mass = None,
    max_tree_depth: TreeDepth = None,
    walkers: Walkers = None,
    start: Start = None,
    resume: Resume = False,
    drop: Drop = False,
) -> None:
    """Fit whole segments: who moves and what they do, for `recognize`.

    Every file is one segment that shows one task; the factors, such as subject and task, are
    the modes of the tensor beside position.
    """
    known_of("kind of channels", channels, CHANNELS)
    known_of("kind of body", body, BODIES)
    known_of("pace", pace, PACES)
    run = run_of(
        out, method, seed, resume, starts=starts, max_steps=max_steps, warmup=warmup, draws=draws,
        chains=chains, mass=mass, max_tree_depth=max_tree_depth, walkers=walkers, start=start,
    )  # fmt: skip
    from ..models.motion_tensor import MotionTensor
    from ..motion.io import read
    from ..motion.recordings import at_rate, labelled, looked_over
    from ..motion.segments import Segmenting
    from .fitting import factors_of, fitted
    from .predicting import filter_named

    motion = looked_over(
        read(*files) if labels is None else labelled(read(*files), labels), dropping=drop
    )
    motion = at_rate(motion, rate, filter_named(filter))
    names = factors_of(factors, motion, labels)
    if len(names) < 2:
        raise InputError("--factors", "the tensor needs two or more", "Write subject,task")
    segmenting = Segmenting(
        cast("Channels", channels), coefficients, samples, cast("Body", body), static,
        cast("Pace", pace),
    )  # fmt: skip
    fitted(MotionTensor(tuple(names), rank, effect_sd, segmenting), motion, run, out, filter)
