"""The command ``contrast``: two conditions' curves, compared over people."""

from pathlib import Path
from typing import Annotated

import typer

from .. import console
from ..errors import InputError
from ..files import CURVES
from .app import pairs
from .outputs import Json, Picture, tell_saved


def contrast(
    curves: Annotated[
        Path,
        typer.Argument(help="A csv table of strides: subject, condition, stride, phase, value."),
    ],
    first: Annotated[
        list[str], typer.Option(help="The first condition, as condition=fast; several all hold.")
    ],
    second: Annotated[list[str], typer.Option(help="The second condition, taken off the first.")],
    value: Annotated[str, typer.Option(help="The column of the values.")] = "value",
    over: Annotated[str, typer.Option(help="What conditions are compared over.")] = "subject",
    covariates: Annotated[
        list[str] | None,
        typer.Option("--covariate", help="Compare at the same value of this column."),
    ] = None,
    rope: Annotated[
        float, typer.Option(min=0.0, help="Differences smaller than this are practically none.")
    ] = 0.0,
    probability: Annotated[float, typer.Option(help="Of bands and regions.")] = 0.95,
    periodic: Annotated[
        bool, typer.Option("--periodic", help="The last phase is followed by the first.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Of the draws.")] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Write mean, sd and bands by phase: .csv or .nc."), CURVES
    ] = None,
    json_file: Json = None,
    plot: Picture = None,
) -> None:
    """Compare two conditions' mean curves over people, with simultaneous bands: no fit is needed.

    Strides are of people: what holds of people is learned from as many as there are. People seen in
    both conditions are compared with themselves; where there are none, two groups are compared.
    """
    from ..files import replacing, write_json
    from ..motion.io.curves import read_curves
    from ..netcdf import write_netcdf
    from ..tasks.contrast import contrast as contrast_of

    if not (first and second):
        raise InputError("a condition", "it is missing", "Give --first and --second")
    found = contrast_of(
        read_curves(curves, value=value), pairs(first, "--first"), pairs(second, "--second"),
        over=over, covariates=covariates or (), rope=rope, probability=probability,
        periodic=periodic, seed=seed,
    )  # fmt: skip
    told = repr(found).split("\n  warning: ")[0]
    console.say(told)
    if rope:
        for region in found.equivalent():
            console.say(f"  {found.said(region)}")
    table = found.to_dataset()
    if out is not None and out.suffix.lower() == ".nc":
        write_netcdf(out, table)
    elif out is not None:
        with replacing(out) as temporary:
            table.to_dataframe().to_csv(temporary, float_format="%.6g")
    if json_file is not None:
        write_json(json_file, {
            "first": dict(found.first), "second": dict(found.second),
            "paired": found.design.paired, "people": list(found.design.names),
            "strides": found.design.strides.tolist(), "probability": probability, "rope": rope,
            "regions": [vars(region) for region in found.regions()],
            "equivalent": [vars(region) for region in found.equivalent()] if rope else [],
            "messages": list(found.messages),
        })  # fmt: skip
    if plot is not None:
        from ..plots.style import save

        save(found.plot(), plot)
    tell_saved(out, json_file, plot)
