"""Options of the commands ``fit MODEL``, and which of them say something to which method."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import InputError

# Which options belong to which method.
METHODS = {
    "map": ("starts", "max_steps"),
    "nuts": ("warmup", "draws", "chains", "mass", "max_tree_depth", "start"),
    "ensemble": ("warmup", "draws", "walkers", "start"),
}
MAP_STEPS = 1000

Files = Annotated[list[Path], typer.Argument(help="Recordings: .amc, .bvh or a saved .nc.")]
Out = Annotated[Path, typer.Option(help="Where the fit is saved (netCDF).")]
Labels = Annotated[
    Path | None,
    typer.Option(
        help="A csv table with one row a clip: clip,subject,gait. An empty cell means "
        "unknown; every further column is a further factor."
    ),
]
Method = Annotated[
    str,
    typer.Option(
        help="map: the posterior mode; nuts: draws from the posterior; ensemble: draws by "
        "walkers, for models of few unknowns."
    ),
]
Factors = Annotated[
    str | None,
    typer.Option(
        help="Factors, with commas: subject,gait. By default all labels; none for no factors."
    ),
]
Rate = Annotated[float, typer.Option(help="Frames a second; must divide that of the files.")]
Filter = Annotated[
    str, typer.Option(help="none keeps every n-th frame as it is; lowpass filters first.")
]
Seed = Annotated[int, typer.Option(min=0, help="Of everything that is random.")]
Starts = Annotated[int | None, typer.Option(min=1, help="map: starting points of the search; 4.")]
MaxSteps = Annotated[
    int | None, typer.Option(min=1, help=f"map: at most so many steps; {MAP_STEPS}.")
]
Warmup = Annotated[
    int | None, typer.Option(min=20, help="nuts, ensemble: iterations thrown away first; 500.")
]
Draws = Annotated[
    int | None,
    typer.Option(
        min=1, help="nuts: draws kept of each chain; ensemble: steps, and draws kept; 500."
    ),
]
Chains = Annotated[int | None, typer.Option(min=1, help="nuts: chains; 4.")]
Mass = Annotated[
    str | None, typer.Option(help="nuts: the mass matrix, diagonal or dense; diagonal.")
]
TreeDepth = Annotated[
    int | None,
    typer.Option(min=1, max=12, help="nuts: at most 2^n - 1 leapfrog steps a draw; 10."),
]
Walkers = Annotated[
    int | None, typer.Option(min=4, help="ensemble: walkers; three for each unknown.")
]
Start = Annotated[
    str | None,
    typer.Option(
        help="nuts, ensemble: begin around the map or at the prior; nuts also: typical, where "
        "draws of hundreds of unknowns are; map."
    ),
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with a run that was interrupted.")]
Drop = Annotated[
    bool, typer.Option("--drop/--keep-suspicious", help="Leave out suspicious frames.")
]


@dataclass(frozen=True)
class Run:
    """How a model is fitted.

    method, seed
        As asked for.
    options
        Those of the method that were set.
    part
        File for a sampler's state, None for a point estimate.
    resume
        Whether to go on from it.
    """

    method: str
    seed: int
    options: dict[str, Any]
    part: Path | None
    resume: bool


def run_of(out: Path, method: str, seed: int, resume: bool, **options: Any) -> Run:
    """Check how a model is to be fitted; options that were not set are None.

    Raises
    ------
    InputError
        If there is no such method, an option says nothing to it, or a run was interrupted
        that is not resumed.
    """
    known_of("method", method, tuple(METHODS))
    known_of("mass matrix", options["mass"] or "diagonal", ("diagonal", "dense"))
    starts = ("map", "typical", "prior") if method == "nuts" else ("map", "prior")
    known_of("start", options["start"] or "map", starts)
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in METHODS[method]:
            dashed = name.replace("_", "-")
            known = ", ".join("--" + own.replace("_", "-") for own in METHODS[method])
            raise InputError(
                f"--{dashed}", f"it says nothing to the method {method}", f"It has {known}"
            )
    return Run(method, seed, given, _part(out, method, resume), resume)


def known_of(what: str, value: str, known: tuple[str, ...]) -> None:
    """Refuse a value that is none of those known."""
    if value not in known:
        raise InputError(repr(value), f"there is no such {what}", f"Use {', '.join(known)}")


def refuse_silent(where: str, **options: Any) -> None:
    """Refuse options that were set and say nothing there; those that were not set are None."""
    for name, value in options.items():
        if value is not None:
            dashed = name.replace("_", "-")
            raise InputError(f"--{dashed}", f"it says nothing {where}", "Leave it out")


def _part(out: Path, method: str, resume: bool) -> Path | None:
    """Give the file for a sampler's state; one that is there needs --resume."""
    from ..inference.checkpoint import part_of

    if method == "map":
        if resume:
            raise InputError("--resume", "the method map has nothing to resume", "Leave it out")
        return None
    part = part_of(out)
    if part.exists() and not resume:
        raise InputError(
            part, "a run was interrupted here", "Go on with --resume, or delete the file"
        )
    return part
