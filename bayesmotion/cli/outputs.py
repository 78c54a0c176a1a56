"""What commands read and write: options that several have, checked before they do any work."""

import functools
import inspect
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import console
from ..errors import InputError
from ..files import BVH, JSON, PICTURE, TABLE, Kind, check_outputs, held, require_file

if TYPE_CHECKING:
    import xarray as xr

    from ..fit import Fit

# Marks arguments that are fits: looked for before what reads them is imported, which takes seconds.
SAVED_FIT = object()
FitFile = Annotated[Path, typer.Argument(help="A fit, as `bayesmotion fit` saved it."), SAVED_FIT]
Bvh = Annotated[Path | None, typer.Option(help="Write the motion as BVH."), BVH]
Picture = Annotated[Path | None, typer.Option(help="Draw a picture: .png, .pdf or .svg."), PICTURE]
Json = Annotated[Path | None, typer.Option("--json", help="Write the result as JSON."), JSON]
Table = Annotated[
    Path | None,
    typer.Option("--out", help="Write mean, sd and quantiles by time and channel: .csv or .nc."),
    TABLE,
]
Most = Annotated[
    int, typer.Option("--most", min=1, help="Average over so many draws of the fit at most.")
]
Drawn = Annotated[
    int,
    typer.Option(
        "--draws", min=0, help="With --bvh: beside the mean write so many motions that are drawn."
    ),
]


def checked(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that refuses what it cannot write, and fits that are not there, at once.

    Outputs are the parameters with a `Kind` in their annotation, all other paths are inputs;
    fits have `SAVED_FIT` in theirs.
    No other process of the user may write the same file while the command runs.
    """
    signature = inspect.signature(command)
    kinds = {
        name: kind
        for name, parameter in signature.parameters.items()
        for kind in getattr(parameter.annotation, "__metadata__", ())
        if isinstance(kind, Kind)
    }
    fits = [
        name
        for name, parameter in signature.parameters.items()
        if SAVED_FIT in getattr(parameter.annotation, "__metadata__", ())
    ]

    @functools.wraps(command)
    def run(*args: Any, **options: Any) -> None:
        given = signature.bind(*args, **options).arguments
        outputs = [(given[name], kind) for name, kind in kinds.items() if given.get(name)]
        inputs = [
            path for name, value in given.items() if name not in kinds for path in _paths(value)
        ]
        check_outputs(outputs, inputs)
        for path in (path for name in fits for path in _paths(given[name])):
            require_file(path)
        with held(path for path, _ in outputs):
            command(*args, **options)

    return run


def _paths(value: object) -> list[Path]:
    """Return what of an option's value are paths."""
    return [one for one in (value if isinstance(value, list) else [value]) if isinstance(one, Path)]


def drawn_files(bvh: Path, count: int) -> list[Path]:
    """Return the files of motions that are drawn: NAME-draw-1.bvh and so on."""
    return [bvh.with_stem(f"{bvh.stem}-draw-{number}") for number in range(1, count + 1)]


def check_drawn(bvh: Path | None, count: int, inputs: Iterable[Path]) -> None:
    """Refuse drawn motions that could not be written beside the one of `bvh`."""
    if count and bvh is None:
        raise InputError(f"--draws {count}", "there is no file for them", "Say --bvh F as well")
    if bvh is not None:
        check_outputs([(path, BVH) for path in drawn_files(bvh, count)], inputs)


def samples_for(fit: "Fit", drawn: int, most: int) -> int:
    """Return of how many motions of every draw of a fit so many can be chosen."""
    sizes = fit.tree["posterior"].sizes
    return max(1, -(-drawn // min(most, sizes["chain"] * sizes["draw"])))


def write_drawn(bvh: Path, motions: "Sequence[xr.Dataset]") -> list[Path]:
    """Write motions beside the one of `bvh`; return the files."""
    from ..motion.io.bvh import write_bvh

    paths = drawn_files(bvh, len(motions))
    for motion, path in zip(motions, paths, strict=True):
        write_bvh(motion, path)
    return paths


def tell_saved(*paths: Path | None) -> None:
    """Say what was written."""
    for path in paths:
        if path is not None:
            console.say(f"saved to {path}")
