"""What commands write: options that several have, and files beside each other."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import console
from ..errors import InputError

if TYPE_CHECKING:
    import xarray as xr

    from ..fit import Fit

Bvh = Annotated[Path | None, typer.Option(help="Write the motion as BVH.")]
Picture = Annotated[Path | None, typer.Option(help="Draw a picture: .png, .pdf or .svg.")]
Json = Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")]
Table = Annotated[
    Path | None,
    typer.Option("--out", help="Write mean, sd and quantiles by time and channel: .csv or .nc."),
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


def check_outputs(out: Path | None, drawn: int, bvh: Path | None) -> None:
    """Refuse, before anything is computed, what could not be written after it."""
    if out is not None and out.suffix.lower() not in (".csv", ".nc"):
        raise InputError(
            f"--out {out}", "tables are not written so", "Use .csv or .nc; --bvh writes motions"
        )
    if drawn and bvh is None:
        raise InputError(f"--draws {drawn}", "there is no file for them", "Say --bvh F as well")


def samples_for(fit: "Fit", drawn: int, most: int) -> int:
    """Return of how many motions of every draw of a fit so many can be chosen."""
    sizes = fit.tree["posterior"].sizes
    return max(1, -(-drawn // min(most, sizes["chain"] * sizes["draw"])))


def write_drawn(bvh: Path | None, motions: "Sequence[xr.Dataset]") -> list[Path]:
    """Write motions beside the one of `bvh`, as NAME-draw-1.bvh and so on."""
    from ..motion.io.bvh import write_bvh

    if bvh is None:
        return []
    paths = [bvh.with_stem(f"{bvh.stem}-draw-{number}") for number in range(1, len(motions) + 1)]
    for motion, path in zip(motions, paths, strict=True):
        write_bvh(motion, path)
    return paths


def of_clip(path: Path | None, clip: str, several: bool) -> Path | None:
    """Return the file of one clip of several: NAME-CLIP.bvh."""
    if path is None or not several:
        return path
    return path.with_stem(f"{path.stem}-{clip.replace('/', '-')}")


def tell_saved(*paths: Path | None) -> None:
    """Say what was written."""
    for path in paths:
        if path is not None:
            console.say(f"saved to {path}")
