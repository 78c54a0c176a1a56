"""The commands ``check`` and ``fit``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from .. import console
from ..errors import InputError
from ..models import MODELS

if TYPE_CHECKING:
    import xarray as xr

    from ..fit import Fit
    from ..models.multifactor import Dynamics, Multifactor

DYNAMICS = ("circle", "gp", "balanced")
# Which options belong to which method.
METHODS = {
    "map": ("starts", "max_steps"),
    "nuts": ("warmup", "draws", "chains", "mass", "max_tree_depth", "start"),
    "ensemble": ("warmup", "draws", "walkers", "start"),
}
MAP_STEPS = 1000
Files = Annotated[list[Path], typer.Argument(help="Recordings: .amc, .bvh, .c3d or a saved .nc.")]


def check(files: Files) -> None:
    """Look recordings over: rest poses, jumps, frozen stretches, feet below the floor.

    Tells what was found and which frames to drop. The exit code is 1 if anything was found.
    """
    from ..motion.check import check as findings_of
    from .recordings import reading, told

    count = 0
    for path in files:
        findings = findings_of(reading(path))
        count += len(findings)
        if not findings:
            console.say(f"{path}: nothing found")
        for finding in findings:
            console.say(f"{path}: {told(finding)}")
    if count:
        raise typer.Exit(1)


def fit(
    model: Annotated[str, typer.Argument(help=f"The model: {', '.join(MODELS)}.")],
    files: Files,
    out: Annotated[Path, typer.Option(help="Where the fit is saved (netCDF).")],
    labels: Annotated[
        Path | None,
        typer.Option(
            help="A csv table with one row a clip: clip,subject,gait. An empty cell means "
            "unknown; every further column is a further factor."
        ),
    ] = None,
    dynamics: Annotated[str, typer.Option(help=f"One of {', '.join(DYNAMICS)}.")] = "circle",
    method: Annotated[
        str,
        typer.Option(
            help="map: the posterior mode; nuts: draws from the posterior; ensemble: draws by "
            "walkers, for models of few unknowns."
        ),
    ] = "map",
    factors: Annotated[
        str | None,
        typer.Option(
            help="Style factors, with commas: subject,gait. By default all labels; none for no "
            "factors."
        ),
    ] = None,
    rate: Annotated[
        float, typer.Option(help="Frames a second; must divide that of the files.")
    ] = 30.0,
    filter: Annotated[
        str, typer.Option(help="none keeps every n-th frame as it is; lowpass filters first.")
    ] = "none",
    seed: Annotated[int, typer.Option(min=0, help="Of everything that is random.")] = 0,
    starts: Annotated[
        int | None, typer.Option(min=1, help="map: starting points of the search; 4.")
    ] = None,
    max_steps: Annotated[
        int | None, typer.Option(min=1, help=f"map: at most so many steps; {MAP_STEPS}.")
    ] = None,
    warmup: Annotated[
        int | None, typer.Option(min=20, help="nuts, ensemble: iterations thrown away first; 500.")
    ] = None,
    draws: Annotated[
        int | None,
        typer.Option(
            min=1, help="nuts: draws kept of each chain; ensemble: steps, and draws kept; 500."
        ),
    ] = None,
    chains: Annotated[int | None, typer.Option(min=1, help="nuts: chains; 4.")] = None,
    mass: Annotated[
        str | None, typer.Option(help="nuts: the mass matrix, diagonal or dense; diagonal.")
    ] = None,
    max_tree_depth: Annotated[
        int | None,
        typer.Option(min=1, max=12, help="nuts: at most 2^n - 1 leapfrog steps a draw; 10."),
    ] = None,
    walkers: Annotated[
        int | None, typer.Option(min=4, help="ensemble: walkers; three for each unknown.")
    ] = None,
    start: Annotated[
        str | None, typer.Option(help="nuts, ensemble: begin around the map or at the prior; map.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a run that was interrupted.")
    ] = False,
    drop: Annotated[
        bool, typer.Option("--drop/--keep-suspicious", help="Leave out suspicious frames.")
    ] = False,
) -> None:
    """Fit a model to recordings and save it.

    With nuts and ensemble the run's state is kept beside the fit, in a file that ends in
    .part, and a run that was interrupted or killed goes on with --resume.
    """
    for value, known, what in (
        (model, MODELS, "model"),
        (dynamics, DYNAMICS, "kind of dynamics"),
        (method, METHODS, "method"),
        (mass or "diagonal", ("diagonal", "dense"), "mass matrix"),
        (start or "map", ("map", "prior"), "start"),
    ):
        if value not in known:
            raise InputError(repr(value), f"there is no such {what}", f"Use {', '.join(known)}")
    options = _of_method(
        method, starts=starts, max_steps=max_steps, warmup=warmup, draws=draws, chains=chains,
        mass=mass, max_tree_depth=max_tree_depth, walkers=walkers, start=start,
    )  # fmt: skip
    part = _part(out, method, resume)
    from ..models.multifactor import Factor, Multifactor
    from .recordings import at_rate, joined, looked_over

    motion = looked_over(joined(files, labels), dropping=drop)
    motion = at_rate(motion, rate, filter)
    names = _factors(factors, motion, labels)
    _tell_unknown(motion, names)
    program = Multifactor(
        dynamics=cast("Dynamics", dynamics), factors=tuple(Factor(name) for name in names)
    )
    if part is None:
        result = _mode(program, motion, seed, options)
    else:
        result = _draws(method, program, motion, seed, options, part, resume)
    result.tree.attrs["filter"] = filter
    result.save(out)
    if part is not None:
        part.unlink(missing_ok=True)
    _tell(result)
    console.say(f"saved to {out}")


def _of_method(method: str, **options: object) -> dict[str, Any]:
    """Give the options that were set, all of which must be the method's own."""
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in METHODS[method]:
            dashed = name.replace("_", "-")
            known = ", ".join("--" + own.replace("_", "-") for own in METHODS[method])
            raise InputError(
                f"--{dashed}", f"it says nothing to the method {method}", f"It has {known}"
            )
    return given


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


def _mode(program: "Multifactor", motion: "xr.Dataset", seed: int, options: dict) -> "Fit":
    from ..inference.map import fit_map

    settings = {"starts": 4, "max_steps": MAP_STEPS, **options}
    with console.progress("fit", settings["max_steps"]) as progress:
        return fit_map(
            program, motion, seed=seed, keep=min(2, settings["starts"]), progress=progress,
            **settings,
        )  # fmt: skip


def _draws(
    method: str,
    program: "Multifactor",
    motion: "xr.Dataset",
    seed: int,
    options: dict,
    part: Path,
    resume: bool,
) -> "Fit":
    from ..inference.ensemble import fit_ensemble
    from ..inference.nuts import fit_nuts

    settings = {"warmup": 500, "draws": 500, **options}
    run = {"seed": seed, "checkpoint": part, "resume": resume}
    total = settings["warmup"] + settings["draws"]
    try:
        with console.progress(method, total) as progress:
            if method == "nuts":
                return fit_nuts(program, motion, progress=progress, **run, **settings)
            settings["steps"] = settings["draws"]
            return fit_ensemble(program, motion, progress=progress, **run, **settings)
    except KeyboardInterrupt:
        if part.exists():
            console.note(f"{part} has the draws so far; --resume goes on from there")
        raise


def _tell(result: "Fit") -> None:
    """Say in one line how the fit went, and what to know before trusting it."""
    stats = result.tree["sample_stats"].ds
    seconds, best = float(result.tree.attrs["seconds"]), float(stats["lp"].values.max())
    if result.tree.attrs["inference"] == "map":
        steps = int(stats["steps"].values.max())
        end = "converged" if stats["converged"].values.all() else "not converged"
        console.say(f"{end} after {steps} steps and {seconds:.1f} seconds, log density {best:.2f}")
        return
    chains, draws = stats.sizes["chain"], stats.sizes["draw"]
    many = f"{chains} chains of {draws} draws" if chains > 1 else f"{draws} draws"
    console.say(f"{many} in {seconds:.1f} seconds, best log density {best:.2f}")
    for warning in json.loads(result.tree.attrs["warnings"]):
        console.note(f"warning: {warning}")


def _factors(text: str | None, motion: "xr.Dataset", labels: Path | None) -> list[str]:
    """Name the style factors: those asked for, else the columns of the table, else all labels."""
    from ..motion.dataset import label_names
    from ..motion.labels import read_labels

    if text is not None:
        return [] if text in ("", "none") else [name.strip() for name in text.split(",")]
    if labels is None:
        return label_names(motion)
    return list(dict.fromkeys(name for row in read_labels(labels).rows.values() for name in row))


def _tell_unknown(motion: "xr.Dataset", names: list[str]) -> None:
    """Say which labels are unknown and will be estimated."""
    from ..models.poses import UNKNOWN, clip_labels

    for name in names:
        unknown = [clip for clip, label in clip_labels(motion, name).items() if label == UNKNOWN]
        if unknown:
            console.note(f"the {name} of {', '.join(unknown)} is unknown and will be estimated")
