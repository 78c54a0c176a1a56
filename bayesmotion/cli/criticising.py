"""The commands ``diagnose``, ``loo`` and ``compare``, for fits of any model."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import console
from ..errors import InputError
from .outputs import SAVED_FIT, FitFile, Json, Picture, tell_saved

if TYPE_CHECKING:
    from ..evaluate.compare import Comparison

UNTRUSTED = 1
DRAWN = 4
Most = Annotated[
    int | None, typer.Option(min=4, help="Look at so many draws at most; by default at all.")
]
By = Annotated[
    str,
    typer.Option(
        help="What is left out: point (a frame, a segment, ...; no new fits), or a label of the "
        "recordings such as clip or subject (fits again without each, as it was fitted)."
    ),
]
POINT = "point"


def diagnose(fit: FitFile, plot: Picture = None, most: Most = None, json_file: Json = None) -> None:
    """Say in words whether a fit is to be trusted; the exit code is 1 if it is not.

    Looks at what data can tell: hyperparameters, styles up to rotation, phases up to a
    common shift, covariances and predictions. --plot draws the worst of these.
    """
    from ..evaluate.diagnostics import diagnose as diagnosis_of
    from ..evaluate.diagnostics import scalars, watched
    from ..files import write_json
    from ..fit import load

    trained = load(fit)
    found = diagnosis_of(trained, most)
    console.say(str(found))
    if json_file is not None:
        write_json(json_file, found.to_dict())
        tell_saved(json_file)
    if plot is not None:
        if not found.quantities:
            raise InputError(
                "--plot", "a point estimate has no chains to draw", "Leave it out, or sample"
            )
        from ..plots import chains_plot, save

        draws = scalars(watched(trained, most), ("chain", "draw"))
        save(chains_plot({q.name: draws[q.name] for q in found.quantities[:DRAWN]}), plot)
        tell_saved(plot)
    if not found.trusted:
        raise typer.Exit(UNTRUSTED)


def loo(fit: FitFile, by: By = POINT, most: Most = None, json_file: Json = None) -> None:
    """Score a fit by the log predictive density of what is left out.

    The number says little by itself: `compare` holds fits of the same recordings against
    each other.
    """
    from ..evaluate.held_out import leave_groups_out
    from ..evaluate.loo import elpd_of_points
    from ..files import write_json
    from ..fit import load

    _require_points("--most", most, by)
    trained = load(fit)
    score = elpd_of_points(trained, most) if by == POINT else leave_groups_out(trained, by)
    high = 0
    console.say(
        f"Log predictive density of {score.n_data_points} {by}s left out: {score.elpd:.2f}, "
        f"standard error {score.se:.2f}"
    )
    if score.pareto_k is not None and score.good_k is not None:
        high = int((~(score.pareto_k.values <= score.good_k)).sum())
        told = f"Pareto k is above {score.good_k:.2f} at {high} of {score.n_data_points} points"
        console.say(f"{told}: their scores are not to be trusted." if high else
                    f"Pareto k is at most {float(score.pareto_k.max()):.2f}.")  # fmt: skip
    elif by == POINT:
        console.say(
            "A point estimate has seen the points left out: the score is somewhat too high."
        )
    if json_file is not None:
        points = score.elpd_i
        assert points is not None
        labels = {str(n): c.values.tolist() for n, c in points.coords.items()}
        result = {"by": by, "elpd": score.elpd, "se": score.se, "high_pareto_k": high,
                  "points": {**labels, "elpd": points.values.tolist()}}  # fmt: skip
        write_json(json_file, result)
        tell_saved(json_file)


def compare(
    fits: Annotated[
        list[Path], typer.Argument(help="Fits of the same recordings, two or more."), SAVED_FIT
    ],
    by: By = POINT,
    most: Most = None,
    json_file: Json = None,
) -> None:
    """Compare fits of the same recordings by how well they predict what was left out."""
    from ..evaluate.compare import compare as compared
    from ..evaluate.compare import numbers, require_same_data
    from ..files import write_json
    from ..fit import load

    _require_points("--most", most, by)
    trained = {name: load(path) for name, path in zip(_names(fits), fits, strict=True)}
    require_same_data(trained)
    if by != POINT:
        console.note(f"fitting without each {by}")
    found = compared(trained, by, most)
    _tell(found, by)
    if json_file is not None:
        rows = [{k: _known(v) for k, v in row.items()} for row in numbers(found.table)]
        write_json(json_file, {"by": by, "models": rows, "sentences": list(found.sentences)})
        tell_saved(json_file)


def _require_points(option: str, value: Any, by: str) -> None:
    if value is not None and by != POINT:
        raise InputError(option, f"it says nothing with --by {by}", "Leave it out")


def _tell(found: "Comparison", by: str) -> None:
    from ..evaluate.compare import numbers

    columns = ("fit", "elpd", "elpd_diff", "dse", "dse_clips", "weight")
    console.table(
        f"Log predictive density of each {by} left out",
        ["fit", "elpd", "difference", "se", "se over clips", "weight"],
        [[_known(row[column]) for column in columns] for row in numbers(found.table)],
    )
    for sentence in found.sentences:
        console.say(sentence)


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
    """Return a value, nothing for one that is not a number."""
    return None if value != value else value
