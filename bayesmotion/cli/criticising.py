"""The commands ``diagnose`` and ``compare``."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import console
from ..errors import InputError
from .fit_options import refuse_silent
from .predicting import FitFile, Picture, pose_fit, tell_saved

if TYPE_CHECKING:
    import xarray as xr

    from ..criticism.compare import Comparison
    from ..fit import Fit

UNTRUSTED = 1
# What can be left out, and the options that say something to it.
BY = {
    "frame": ("most",),
    "clip": ("given", "horizon", "max_steps"),
    "future": ("horizon", "max_steps"),
}
GIVEN, HORIZON = 25, 40
SHOWN, DRAWN = 8, 4
Most = Annotated[
    int | None, typer.Option(min=4, help="Look at so many draws at most; by default at all.")
]


def diagnose(fit: FitFile, plot: Picture = None, most: Most = None) -> None:
    """Say in words whether a fit is to be trusted; the exit code is 1 if it is not.

    Looks at what data can tell: hyperparameters, styles up to rotation, phases up to a
    common shift, covariances and predictions. --plot draws the worst of these.
    """
    from ..criticism.diagnostics import diagnose as diagnosis_of
    from ..criticism.diagnostics import scalars, watched

    trained = pose_fit(fit)
    found = diagnosis_of(trained, most)
    for sentence in found.sentences:
        console.say(sentence)
    if found.quantities:
        console.say("")
        console.table(
            "The worst",
            ["quantity", "R-hat", "bulk ESS", "tail ESS", "mean", "sd", "MCSE"],
            [
                (q.name, q.r_hat, round(q.ess_bulk), _whole(q.ess_tail), q.mean, q.sd, q.mcse)
                for q in found.quantities[:SHOWN]
            ],
        )
        console.say("")
    if plot is not None:
        if not found.quantities:
            raise InputError(
                "--plot", "a point estimate has no chains to draw", "Leave it out, or sample"
            )
        from ..plots import chains_plot, save

        draws = scalars(watched(trained, most), ("chain", "draw"))
        save(chains_plot({q.name: draws[q.name] for q in found.quantities[:DRAWN]}), plot)
        tell_saved(plot)
    if found.trusted:
        console.say("Nothing speaks against this fit.")
        return
    console.say("This fit is not to be trusted:")
    for problem in found.problems:
        console.say(f"- {problem}")
    raise typer.Exit(UNTRUSTED)


def compare(
    fits: Annotated[list[Path], typer.Argument(help="Fits of the same clips, at least two.")],
    by: Annotated[
        str,
        typer.Option(
            help="What is left out: frame (no new fits), clip or future (fits again by the "
            "posterior mode)."
        ),
    ] = "frame",
    given: Annotated[
        int | None, typer.Option(min=2, help=f"clip: frames given of it; {GIVEN}.")
    ] = None,
    horizon: Annotated[
        int | None, typer.Option(min=1, help=f"clip, future: frames predicted; {HORIZON}.")
    ] = None,
    max_steps: Annotated[
        int | None,
        typer.Option(min=1, help="clip, future: steps of each new fit; by default as in the fit."),
    ] = None,
    most: Annotated[
        int | None,
        typer.Option(min=4, help="frame: look at so many draws at most; by default at all."),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the table.")] = None,
) -> None:
    """Compare fits of the same clips by how well they predict what was left out."""
    if by not in BY:
        raise InputError(f"--by {by}", "that cannot be left out", f"Use {', '.join(BY)}")
    options = {"given": given, "horizon": horizon, "max_steps": max_steps, "most": most}
    silent = [name for name in options if name not in BY[by]]
    refuse_silent(f"with --by {by}", **{name: options[name] for name in silent})
    from ..criticism.compare import compare as compared
    from ..criticism.compare import compare_scores, numbers, require_same_data
    from ..files import write_json

    names = _names(fits)
    trained = {name: pose_fit(path) for name, path in zip(names, fits, strict=True)}
    require_same_data(trained)
    if by == "frame":
        found = compared(trained, most=most)
    else:
        scores = {}
        for name, one in trained.items():
            console.note(f"{name}: fitting without each {by}")
            scores[name] = _refitted(one, by, given or GIVEN, horizon or HORIZON, max_steps)
        found = compare_scores(scores)
    _tell(found, by)
    if json_file is not None:
        rows = [{k: _known(v) for k, v in row.items()} for row in numbers(found.table)]
        write_json(json_file, {"by": by, "models": rows, "sentences": list(found.sentences)})
        tell_saved(json_file)


def _tell(found: "Comparison", by: str) -> None:
    from ..criticism.compare import numbers

    columns = ("fit", "elpd", "elpd_diff", "dse", "dse_clips", "weight")
    ends = by == "future"
    console.table(
        f"Log predictive density of {'the ends of clips' if ends else f'each {by} left out'}",
        ["fit", "elpd", "difference", "se", "se over clips", "weight"],
        [[_known(row[column]) for column in columns] for row in numbers(found.table)],
    )
    for sentence in found.sentences:
        console.say(sentence)


def _refitted(fit: "Fit", by: str, given: int, horizon: int, max_steps: int | None):
    """Leave out clips or ends by fitting a point estimate again."""
    from ..criticism.folds import leave_clips_out
    from ..criticism.future import leave_future_out
    from ..motion.joining import split

    if fit.tree.attrs["inference"] != "map":
        raise InputError(
            f"--by {by}",
            "it fits again by the posterior mode, and this fit has draws",
            "Use --by frame, or bayesmotion.criticism from Python, with a fit of the same kind",
        )
    refit = _again(fit, max_steps)
    if by == "future":
        return leave_future_out(fit, refit, horizon=horizon)
    lengths = {}
    for clip, part in split(fit.motion).items():
        room = part.sizes["frame"]
        # Short clips are given and predicted in the same proportion.
        first = min(given, room * given // (given + horizon))
        lengths[clip] = (max(first, 2), min(horizon, room - max(first, 2)))
    return leave_clips_out(fit, refit, lengths=lengths)


def _again(fit: "Fit", max_steps: int | None) -> "Callable[[xr.Dataset], Fit]":
    """Give what fits the same model to other clips, with the settings it was fitted with."""
    from ..inference.map import fit_map

    settings = json.loads(str(fit.tree.attrs["settings"]))
    if max_steps is not None:
        settings["max_steps"] = max_steps
    preparation = json.loads(str(fit.tree.attrs["preparation"]))
    seed = int(fit.tree.attrs["seed"])

    def refit(motion: "xr.Dataset") -> "Fit":
        return fit_map(fit.model, motion, seed=seed, preparation=preparation, **settings)

    return refit


def _names(fits: list[Path]) -> list[str]:
    """Call fits after their files, by the folder too where files are called alike."""
    stems = [path.stem for path in fits]
    if len(set(stems)) == len(stems):
        return stems
    names = [str(path) for path in fits]
    if len(set(names)) < len(names):
        raise InputError("compare", "a fit is named twice", "Name each once")
    return names


def _known(value: object) -> object:
    """Give a value, nothing for one that is not a number."""
    return None if value != value else value


def _whole(value: float | None) -> int | None:
    return None if value is None else round(value)
