"""The commands ``check`` and ``fit``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from .. import console
from ..errors import InputError

if TYPE_CHECKING:
    import xarray as xr

    from ..models.multifactor import Dynamics

MODELS = ("multifactor",)
DYNAMICS = ("circle", "gp", "balanced")
METHODS = ("map",)
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
    method: Annotated[str, typer.Option(help="map: the posterior mode.")] = "map",
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
    seed: Annotated[int, typer.Option(min=0, help="Of the random part of the starts.")] = 0,
    starts: Annotated[int, typer.Option(min=1, help="Starting points of the search.")] = 4,
    max_steps: Annotated[int, typer.Option(min=1, help="At most so many steps.")] = 1000,
    drop: Annotated[
        bool, typer.Option("--drop/--keep-suspicious", help="Leave out suspicious frames.")
    ] = False,
) -> None:
    """Fit a model to recordings and save it."""
    for value, known, what in (
        (model, MODELS, "model"),
        (dynamics, DYNAMICS, "kind of dynamics"),
        (method, METHODS, "method"),
    ):
        if value not in known:
            raise InputError(repr(value), f"there is no such {what}", f"Use {', '.join(known)}")
    from ..inference.map import fit_map
    from ..models.multifactor import Factor, Multifactor
    from .recordings import at_rate, joined, looked_over

    motion = looked_over(joined(files, labels), dropping=drop)
    motion = at_rate(motion, rate, filter)
    names = _factors(factors, motion, labels)
    _tell_unknown(motion, names)
    program = Multifactor(
        dynamics=cast("Dynamics", dynamics), factors=tuple(Factor(name) for name in names)
    )
    with console.progress("fit", max_steps) as progress:
        result = fit_map(
            program, motion, seed=seed, starts=starts, keep=min(2, starts), max_steps=max_steps,
            progress=progress,
        )  # fmt: skip
    result.tree.attrs["filter"] = filter
    result.save(out)
    stats = result.tree["sample_stats"].ds
    steps, seconds = int(stats["steps"].values.max()), float(result.tree.attrs["seconds"])
    end = "converged" if stats["converged"].values.all() else "not converged"
    console.say(
        f"{end} after {steps} steps and {seconds:.1f} seconds, "
        f"log density {float(stats['lp'].values.max()):.2f}"
    )
    console.say(f"saved to {out}")


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
