"""The command ``calibrate``."""

from pathlib import Path
from typing import Annotated, cast

import typer

from .. import console
from ..criticism.small import KINDS, small_trial
from ..errors import InputError

CONTROLS = ("none", "prior", "frames", "noise")
STARTS = ("truth", "prior")
_KINDS = "; ".join(
    f"of {model} {', '.join(kinds)}" for model, kinds in KINDS.items() if len(kinds) > 1
)


def calibrate(
    model: Annotated[str, typer.Argument(help=f"The model: {', '.join(KINDS)}.")],
    kind: Annotated[
        str | None,
        typer.Option(help=f"Which small version, by default the first: {_KINDS}."),
    ] = None,
    simulations: Annotated[int, typer.Option(min=10, help="How often to draw and fit.")] = 200,
    control: Annotated[
        str,
        typer.Option(help="What is made wrong on purpose: prior, frames (shuffled) or noise."),
    ] = "none",
    start: Annotated[
        str, typer.Option(help="Where chains begin: truth, or another draw from the prior.")
    ] = "truth",
    seed: Annotated[int, typer.Option(min=0, help="Of everything.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Where ranks are saved (netCDF).")] = None,
    json: Annotated[Path | None, typer.Option(help="Where p-values are saved.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Where the ranks are drawn.")] = None,
) -> None:
    """Check on simulated data that posteriors mean what they say.

    A small version of the model is drawn from its prior and fitted by NUTS, many times;
    where the true values stand among the draws must be uniform. The exit code is 1 if it
    is not, which a control must bring about.
    """
    for value, known, what in (
        (control, CONTROLS, "control"),
        (start, STARTS, "start"),
    ):
        if value not in known:
            raise InputError(repr(value), f"there is no such {what}", f"Use {', '.join(known)}")
    from ..criticism import calibration, verdict
    from ..criticism.chains import Chains, Start
    from ..criticism.controls import Control
    from ..files import replacing, write_json

    trial, data = small_trial(model, kind)
    with console.progress("calibrate", simulations, "simulations") as progress:
        tree = calibration.calibrate(
            trial,
            data,
            simulations=simulations,
            seed=seed,
            control=cast("Control", control),
            chains=Chains(start=cast("Start", start)),
            progress=progress,
        )
    said, told = verdict.verdict(tree), verdict.summary(tree)
    console.table(
        f"Ranks of {simulations} simulations against uniform ones",
        ["quantity", "p-value"],
        list(said.p.items()),
    )
    console.say(
        f"{said.sentence}\ndivergences in {told['simulations_with_divergences']} simulations, "
        f"{told['leapfrogs_per_iteration']:.0f} leapfrogs an iteration, {told['seconds']:.0f} s"
    )
    if out is not None:
        with replacing(out) as temporary:
            tree.to_netcdf(temporary, engine="h5netcdf")
        console.say(f"saved to {out}")
    if json is not None:
        write_json(json, told)
        console.say(f"saved to {json}")
    if plot is not None:
        from ..plots import save
        from ..plots.calibration import rank_ecdfs

        console.say(f"saved to {save(rank_ecdfs(tree), plot)}")
    if not said.calibrated:
        raise typer.Exit(1)
