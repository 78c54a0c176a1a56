"""The command ``calibrate``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from .. import console
from ..errors import InputError
from ..files import JSON, PICTURE, RANKS
from ..seeds import MAX_SEED

if TYPE_CHECKING:
    from ..model import SBCCase

STARTS = ("truth", "prior")


def calibrate(
    model: Annotated[str, typer.Argument(help="The model, such as multifactor.")],
    setting: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="A setting of the model, as in --set residual=white; repeatable."
        ),
    ] = None,
    simulations: Annotated[int, typer.Option(min=10, help="How often to draw and fit.")] = 200,
    control: Annotated[
        str,
        typer.Option(
            help="What is made wrong on purpose: prior (sd a third), frames (shuffled), noise "
            "(variance x 4); narrow_prior (sd x 2/3), noise_sd (x 1.2), lag (one row late)."
        ),
    ] = "none",
    start: Annotated[
        str, typer.Option(help="Where chains begin: truth, or another draw from the prior.")
    ] = "truth",
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Of everything.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Where ranks are saved (netCDF)."), RANKS] = None,
    json: Annotated[Path | None, typer.Option(help="Where p-values are saved."), JSON] = None,
    plot: Annotated[Path | None, typer.Option(help="Where the ranks are drawn."), PICTURE] = None,
) -> None:
    """Check on simulated data that posteriors mean what they say.

    The model is drawn from its prior at a small size and fitted by NUTS, many times; where
    the true values stand among the draws must be uniform. The exit code is 1 if it is not,
    which a gross control must bring about.
    """
    from ..evaluate.sbc import calibration, rank_test
    from ..evaluate.sbc.chains import Chains, Start
    from ..evaluate.sbc.controls import FAULTS
    from ..files import write_json
    from ..netcdf import write_netcdf

    for value, known, what in ((control, FAULTS, "control"), (start, STARTS, "start")):
        if value not in known:
            raise InputError(repr(value), f"there is no such {what}", f"Use {', '.join(known)}")
    case, data = _case(model, setting or [])
    with console.progress("calibrate", simulations, "simulations") as progress:
        tree = calibration.calibrate_case(
            case,
            data,
            simulations=simulations,
            seed=seed,
            control=control,
            chains=Chains(start=cast("Start", start)),
            progress=progress,
        )
    found, figures = rank_test.rank_test(tree), rank_test.summary(tree)
    console.table(
        f"Ranks of {simulations} simulations against uniform ones",
        ["quantity", "p-value"],
        list(found.p.items()),
    )
    console.say(
        f"{found.sentence}\ndivergences in {figures['simulations_with_divergences']} simulations, "
        f"{figures['leapfrogs_per_iteration']:.0f} leapfrogs an iteration, "
        f"{figures['seconds']:.0f} s"
    )
    if out is not None:
        write_netcdf(out, tree)
        console.say(f"saved to {out}")
    if json is not None:
        write_json(json, figures)
        console.say(f"saved to {json}")
    if plot is not None:
        from ..plots import save
        from ..plots.calibration import rank_ecdfs

        console.say(f"saved to {save(rank_ecdfs(tree), plot)}")
    if not found.calibrated:
        raise typer.Exit(1)


def _case(name: str, settings: list[str]) -> "tuple[SBCCase, Any]":
    """Return the calibration case of a model with settings."""
    from dataclasses import fields, replace

    from ..registry import model_class
    from ..studies.calibration.study import default_model
    from .settings import settings_from

    own: Any = model_class(name.replace("-", "_"))
    names = [field.name for field in fields(own)]
    given: dict[str, str] = {}
    for text in settings:
        key, sign, value = text.partition("=")
        if not sign or key.replace("-", "_") not in names:
            raise InputError(
                f"--set {text}", f"{name} has no such setting",
                f"Write name=value; it has {', '.join(names)}",
            )  # fmt: skip
        given[key.replace("-", "_")] = value
    return replace(default_model(own), **settings_from(own, given, "--set ")).sbc_case()
