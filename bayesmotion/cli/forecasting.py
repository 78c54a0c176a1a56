"""The command ``forecast``, of one clip or of many in one go."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import console
from ..errors import InputError
from ..files import BVH, PAGE, PICTURE, SCORES, Kind, check_outputs, replacing, write_json
from ..seeds import MAX_SEED
from .app import BAD_INPUT, Body, FrameRate
from .outputs import (
    Bvh,
    Drawn,
    FitFile,
    Json,
    Most,
    Open,
    Page,
    Picture,
    Table,
    check_drawn,
    drawn_files,
    opened,
    samples_for,
    tell_saved,
    write_drawn,
)
from .predicting import Gait, Label, Subject, filter_named, labels_of

if TYPE_CHECKING:
    import xarray as xr

    from ..fit import Fit
    from ..motion.resampling import Filter
    from ..tasks.forecast import Forecast
    from ..tasks.forecast_scores import ForecastScores

# Draws that are seen on a page.
GHOSTS = 30


def forecast(
    fit: FitFile,
    clips: Annotated[list[Path], typer.Argument(help="Recordings: .amc, .bvh or a saved .nc.")],
    context: Annotated[
        int, typer.Option(min=1, help="Frames that are looked at, at the fit's rate.")
    ] = 25,
    horizon: Annotated[
        int, typer.Option(min=1, help="Frames to forecast, at the fit's rate.")
    ] = 40,
    label: Label = None,
    subject: Subject = None,
    gait: Gait = None,
    filter: Annotated[
        str,
        typer.Option(
            help="Of clips of another frame rate: lowpass, or none, which keeps every n-th frame."
        ),
    ] = "lowpass",
    most: Most = 100,
    draws: Drawn = 0,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Of all that is random.")] = 0,
    joint: Annotated[
        list[str] | None,
        typer.Option(help="Of the picture: words of an angle, such as 'left knee'; repeatable."),
    ] = None,
    out: Table = None,
    json_file: Json = None,
    scores: Annotated[
        Path | None, typer.Option(help="Write the scores as CSV, one row a clip."), SCORES
    ] = None,
    bvh: Bvh = None,
    plot: Picture = None,
    page: Page = None,
    show: Open = False,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Forecast how clips go on from their first frames, averaged over the draws of a fit.

    Where a clip goes on long enough, tells the mean error in radians (the norm over the
    angular features), that of three simple forecasts, CRPS, log score, and how often intervals
    held. Warns of what no training clip shows. Of a point estimate intervals leave out how
    unsure the trained model is. --view writes a page on which the forecast moves, beside what
    happened, with draws as ghosts. Of several clips files are called by them, and the table of
    --out holds them all; one that cannot be used is told, and the others are forecast.
    """
    from ..fit import load
    from ..motion.io.recordings import read_each
    from ..motion.io.tables import write_table
    from ..tasks.outcome import joined

    check_drawn(bvh, draws, [fit, *clips])
    if show and page is None:
        raise InputError("--open", "there is no page to open", "Say --view F.html as well")
    trained = load(fit)
    how = filter_named(filter)
    asked = _Asked(
        context, horizon, labels_of(label, subject, gait), how, most,
        samples_for(trained, draws if page is None else max(draws, GHOSTS), most), seed,
    )  # fmt: skip
    recordings = read_each(clips, frame_rate=frame_rate, skeleton=skeleton)
    several = len(recordings) > 1
    if several:
        _check_files(bvh, draws, plot, page, list(recordings), [fit, *clips])
    rows, tables, failed, saved, pages = [], [], 0, [], []
    for name, recorded in recordings.items():
        try:
            done = _one(trained, name, recorded, asked)
        except InputError as reason:
            if not several:
                raise
            console.error(reason)
            failed += 1
            rows.append({**_row(name, asked), "why": str(reason)})
            continue
        rows.append(done.row)
        if not several:
            _tell(done, asked)
        if out is not None:
            tables.append(done.result.to_dataset())
        own = [_of_clip(path, name) if several else path for path in (bvh, plot, page)]
        saved += _write(trained, done, own[0], draws, own[1], joint or [])
        if own[2] is not None:
            pages.append(_write_page(done, own[2]))
    if several:
        _tell_all(rows)
    if trained.point_estimate:
        console.note("a point estimate: intervals leave out how unsure the trained model is")
    if out is not None and tables:
        write_table(joined(tables), out)
    if json_file is not None:
        write_json(json_file, {"clips": rows} if several else rows[0])
    if scores is not None:
        _write_scores(rows, scores)
    tell_saved(json_file, scores, out if tables else None, *saved, *pages)
    for one in pages[:1]:
        opened(one, show)
    if failed:
        console.note(f"{failed} of {len(rows)} clips could not be forecast")
        raise typer.Exit(BAD_INPUT)


def _of_clip(path: Path | None, clip: str) -> Path | None:
    """Return the file of one clip of several: NAME-CLIP.bvh."""
    return None if path is None else path.with_stem(f"{path.stem}-{clip.replace('/', '-')}")


def _check_files(
    bvh: Path | None, draws: int, plot: Path | None, page: Path | None, clips: list[str],
    inputs: list[Path],
) -> None:  # fmt: skip
    """Refuse files of single clips that could not be written."""
    files: list[tuple[Path, Kind]] = []
    for clip in clips:
        if (motion := _of_clip(bvh, clip)) is not None:
            files += [(path, BVH) for path in (motion, *drawn_files(motion, draws))]
        if (picture := _of_clip(plot, clip)) is not None:
            files.append((picture, PICTURE))
        if (moving := _of_clip(page, clip)) is not None:
            files.append((moving, PAGE))
    check_outputs(files, inputs)


@dataclass(frozen=True)
class _Asked:
    """What is asked of every clip."""

    context: int
    horizon: int
    labels: dict[str, str]
    filter: "Filter"
    most: int
    samples: int
    seed: int


@dataclass(frozen=True)
class _Done:
    """A forecast, what really happened, and the row that tells of it."""

    whole: "xr.Dataset"
    result: "Forecast"
    found: "ForecastScores | None"
    row: dict[str, Any]


def _row(name: str, asked: _Asked) -> dict[str, Any]:
    """Return a row in which nothing is known yet."""
    unknown = ("error", "crps", "log_score", "coverage", "baselines", "per_frame", "draws", "of")
    row: dict[str, Any] = {"clip": name, "context": asked.context, "horizon": asked.horizon}
    return {**row, **dict.fromkeys(unknown), "messages": []}


def _one(trained: "Fit", name: str, recorded: "xr.Dataset", asked: _Asked) -> _Done:
    """Forecast one clip, and judge it."""
    from ..motion.resampling import at_rate
    from ..tasks.forecast import forecast as forecast_of
    from ..tasks.forecast_scores import forecast_scores

    whole, _ = at_rate(recorded, trained.frame_rate, filter=asked.filter)
    result = forecast_of(
        trained, recorded, context=asked.context, horizon=asked.horizon, labels=asked.labels,
        draws=asked.most, samples=asked.samples, seed=asked.seed, filter=asked.filter,
    )  # fmt: skip
    found = forecast_scores(trained, whole, result)
    row = _row(name, asked) | {"messages": list(result.messages)}
    row |= {"draws": result.prediction.draws, "of": result.prediction.of}
    if found is None:
        row["why"] = (
            f"the clip has {whole.sizes['frame']} frames at {trained.frame_rate:g} a second, "
            f"{asked.context + asked.horizon} are needed to tell the error"
        )
        return _Done(whole, result, None, row)
    scores = found.scores
    row |= {"error": scores.error, "crps": scores.crps, "log_score": scores.log_score}
    row |= {"coverage": {f"{100 * p:.0f}": held for p, held in scores.coverage.items()}}
    row |= {"baselines": found.baselines, "per_frame": found.per_frame.tolist()}
    return _Done(whole, result, found, row)


def _tell(done: _Done, asked: _Asked) -> None:
    """Say how good the forecast of one clip is."""
    name, found = done.row["clip"], done.found
    if found is None:
        console.say(f"{name}: no error: {done.row['why']}")
        return
    rows = [("forecast", found.error), *found.baselines.items()]
    console.table(
        f"{name}: mean error over {asked.horizon} frames",
        ["", "radians"],
        [(row.replace("_", " "), error) for row, error in rows],
    )
    scores = found.scores
    console.say(f"CRPS {scores.crps:.4f} radians, log score {scores.log_score:.2f} an angle")
    held = ", ".join(f"the {p:.0%} one {held:.1%}" for p, held in scores.coverage.items())
    console.say(f"intervals held of the angles: {held}")


def _tell_all(rows: list[dict[str, Any]]) -> None:
    """Say how good the forecasts of several clips are, one row each."""
    simple = list(next((row["baselines"] for row in rows if row["baselines"]), {}))
    cells = []
    for row in rows:
        baselines, coverage = row["baselines"] or {}, row["coverage"] or {}
        errors = [row["error"], *(baselines.get(name) for name in simple)]
        cells.append([row["clip"], *errors, coverage.get("90"), len(row["messages"])])
    console.table(
        f"Mean error in radians over {rows[0]['horizon']} frames",
        ["clip", "forecast", *(n.replace("_", " ") for n in simple), "90 % held", "warnings"],
        cells,
    )
    for row in rows:
        if "why" in row and row["draws"] is not None:
            console.say(f"{row['clip']}: no error: {row['why']}")


def _write(
    trained: "Fit", done: _Done, bvh: Path | None, draws: int, plot: Path | None, joints: list[str]
) -> list[Path]:
    """Write the motion, draws of it and the picture of one clip; return the files."""
    from ..motion.io.bvh import write_bvh

    saved = []
    if bvh is not None:
        write_bvh(done.result.motion, bvh)
        saved += [bvh, *write_drawn(bvh, done.result.draws(draws) if draws else [])]
    if plot is not None:
        from ..plots import save
        from ..tasks.forecast_scores import forecast_picture

        save(forecast_picture(trained, done.whole, done.result, joints), plot)
        saved.append(plot)
    return saved


def _write_page(done: _Done, path: Path) -> Path:
    """Write the page on which the forecast moves over what happened."""
    from ..view.viewer import view

    result, length = done.result, done.result.context + done.result.horizon
    title = f"{done.row['clip']}: {result.horizon} frames forecast from {result.context}"
    shown = view(result, truth=done.whole.isel(frame=slice(length)), draws=GHOSTS,
                 names=["forecast"], title=title)  # fmt: skip
    return shown.write(path)


def _write_scores(rows: list[dict[str, Any]], path: Path) -> None:
    """Write one row a clip as CSV."""
    import pandas as pd

    flat = []
    for row in rows:
        kept = {k: v for k, v in row.items() if k not in ("coverage", "baselines", "per_frame")}
        kept |= {f"coverage{share}": held for share, held in (row["coverage"] or {}).items()}
        kept |= {f"baseline_{name}": error for name, error in (row["baselines"] or {}).items()}
        flat.append({**kept, "messages": " | ".join(row["messages"])})
    with replacing(path) as temporary:
        pd.DataFrame(flat).to_csv(temporary, index=False)
