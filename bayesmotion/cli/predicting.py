"""The commands ``forecast`` and ``synthesize``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import console
from ..errors import InputError
from ..files import BVH, JSON, PICTURE, check_outputs, write_json
from ..seeds import MAX_SEED
from .app import Body, FrameRate, pairs

if TYPE_CHECKING:
    from ..fit import Fit
    from ..motion.io.recordings import Filter

FitFile = Annotated[Path, typer.Argument(help="A fit, as `bayesmotion fit` saved it.")]
Label = Annotated[
    list[str] | None, typer.Option(help="factor=level, as often as there are factors.")
]
Subject = Annotated[str | None, typer.Option(help="Short for --label subject=...")]
Gait = Annotated[str | None, typer.Option(help="Short for --label gait=...")]
Draws = Annotated[int, typer.Option(min=1, help="At most so many draws of the fit.")]
Bvh = Annotated[Path | None, typer.Option(help="Write the motion as BVH."), BVH]
Picture = Annotated[Path | None, typer.Option(help="Draw a picture: .png, .pdf or .svg."), PICTURE]


def forecast(
    fit: FitFile,
    clip: Annotated[Path, typer.Argument(help="A recording: .amc, .bvh or a saved .nc.")],
    context: Annotated[
        int, typer.Option(min=2, help="Frames that are looked at, at the fit's rate.")
    ] = 25,
    horizon: Annotated[int, typer.Option(min=1, help="Frames to forecast.")] = 40,
    label: Label = None,
    subject: Subject = None,
    gait: Gait = None,
    filter: Annotated[
        str | None, typer.Option(help="none or lowpass; by default as in the fit.")
    ] = None,
    draws: Draws = 100,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Of all that is random.")] = 0,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the scores."), JSON
    ] = None,
    bvh: Bvh = None,
    plot: Picture = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Forecast how a clip goes on from its first frames, averaged over the draws of a fit.

    Where the clip goes on long enough, tells the mean error in radians (the norm over the
    angular features), that of three simple forecasts, CRPS, log score, and how often intervals
    held. Warns of what no training clip shows. Of a point estimate intervals leave out how
    unsure the trained model is.
    """
    from ..fit import load
    from ..motion.dataset import clips
    from ..motion.io.bvh import write_bvh
    from ..motion.io.recordings import at_rate, factor_of, read_clip
    from ..tasks.forecast import forecast as forecast_of
    from ..tasks.report import forecast_picture, report

    known = _labels(label, subject, gait)
    trained = load(fit)
    rate = float(trained.motion.attrs["frame_rate"])
    how = filter_of(trained) if filter is None else filter_named(filter)
    recorded = read_clip(clip, frame_rate=frame_rate, skeleton=skeleton)
    whole = at_rate(recorded, rate, how)
    # The context frames are filtered without those that follow them: no look ahead.
    end = (context - 1) * factor_of(recorded, rate) + 1
    past = whole if how == "none" else at_rate(recorded.isel(frame=slice(end)), rate, how)
    result = forecast_of(
        trained, past, context=context, horizon=horizon, labels=known, draws=draws, seed=seed
    )
    found = report(trained, whole, result)
    name = clips(recorded)[0]
    content: dict = {"clip": name, "context": context, "horizon": horizon, "error": None}
    content |= {"crps": None, "log_score": None, "coverage": None, "baselines": None}
    content |= {"per_frame": None, "draws": result.prediction.draws, "of": result.prediction.of}
    content |= {"messages": list(result.messages)}
    if found is None:
        content["why"] = (
            f"the clip has {whole.sizes['frame']} frames at {rate:g} a second, "
            f"{context + horizon} are needed to tell the error"
        )
        console.say(f"{name}: no error: {content['why']}")
    else:
        scores = found.scores
        content |= {"error": scores.error, "crps": scores.crps, "log_score": scores.log_score}
        content |= {"coverage": {f"{100 * p:.0f}": held for p, held in scores.coverage.items()}}
        content |= {"baselines": found.baselines, "per_frame": found.per_frame.tolist()}
        rows = [("forecast", found.error), *found.baselines.items()]
        console.table(
            f"{name}: mean error over {horizon} frames",
            ["", "radians"],
            [(row.replace("_", " "), error) for row, error in rows],
        )
        console.say(f"CRPS {scores.crps:.4f} radians, log score {scores.log_score:.2f} an angle")
        held = ", ".join(f"the {p:.0%} one {held:.1%}" for p, held in scores.coverage.items())
        console.say(f"intervals held of the angles: {held}")
    if trained.point_estimate:
        console.note("a point estimate: intervals leave out how unsure the trained model is")
    if json_file is not None:
        write_json(json_file, content)
    if bvh is not None:
        write_bvh(result.motion, bvh)
    if plot is not None:
        from ..plots import save

        save(forecast_picture(trained, whole, result), plot)
    tell_saved(json_file, bvh, plot)


def filter_of(trained: "Fit") -> "Filter":
    """Return the filter that the training clips went through."""
    reading = json.loads(str(trained.tree.attrs.get("reading", "{}")))
    return filter_named(str(reading.get("filter", "none")))


def filter_named(name: str) -> "Filter":
    """Return a filter that there is; refuse others."""
    if name != "none" and name != "lowpass":
        raise InputError(f"--filter {name}", "there is no such filter", "Use none or lowpass")
    return name


def synthesize(
    fit: FitFile,
    bvh: Annotated[Path, typer.Option(help="Where the motion is written, as BVH."), BVH],
    seconds: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            help="Length of the motion; 5, on a surface 2, or of a tensor that of the segments.",
        ),
    ] = None,
    label: Label = None,
    subject: Subject = None,
    gait: Gait = None,
    transition: Annotated[
        str | None, typer.Option(help="Change one factor on the way: gait=walk,run.")
    ] = None,
    sample: Annotated[
        int | None, typer.Option(min=1, help="Make so many motions of styles drawn at random.")
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, max=MAX_SEED, help="Of the first of these motions.")
    ] = 0,
    draws: Draws = 100,
    path: Annotated[
        str | None,
        typer.Option(help="Of a gait_pose fit, on its surface: line, inner-spiral, outer-spiral."),
    ] = None,
    plot: Picture = None,
) -> None:
    """Make a motion nobody recorded: of any combination of the levels that were learned.

    It is the mean over the draws of the fit.

    With --transition one factor changes on the way; with --sample the styles are drawn at
    random and the files are numbered from the second on. A gait_pose fit walks along a --path
    on its surface.
    """
    from ..fit import load
    from ..motion.io.bvh import write_bvh
    from ..tasks import synthesise
    from ..verbs import ConditionsOnCycles, PredictsCells

    levels = _labels(label, subject, gait)
    if sample is not None and (levels or transition):
        raise InputError("--sample", "styles are drawn at random", "Leave out labels")
    files = [_numbered(bvh, i) for i in range(sample or 1)]
    check_outputs([(file, BVH) for file in files], [fit])
    trained = load(fit)
    if path is not None:
        from .gait import synthesise_path

        if levels or sample is not None or transition is not None:
            raise InputError("--path", "a path on a surface has no labels", "Leave them out")
        synthesise_path(trained, path, seconds, bvh, plot)
        return
    if isinstance(trained.model, ConditionsOnCycles):
        raise InputError(
            fit, f"it is a fit of {trained.model.name}", "Say which --path on its surface"
        )
    if isinstance(trained.model, PredictsCells):
        if sample is not None or transition is not None:
            raise InputError(
                "--sample, --transition", "the tensor makes single cells", "Give a level of each"
            )
        _synthesise_cell(trained, levels, seconds, bvh, plot)
        return
    seconds = 5.0 if seconds is None else seconds
    if sample is not None:
        made = [synthesise.sampled(trained, seconds, seed + i, draws=draws) for i in range(sample)]
    elif transition is not None:
        ((factor, way),) = pairs([transition], "--transition").items()
        stations = tuple(way.split(","))
        if len(stations) < 2 or factor in levels:
            raise InputError(
                "--transition", f"{transition!r} is no way", f"Write {factor}=a,b and no --{factor}"
            )
        _require_all(trained, levels, factor)
        made = [synthesise.transition(trained, levels, factor, stations, seconds, draws=draws)]
    else:
        _require_all(trained, levels)
        made = [synthesise.synthesize(trained, levels, seconds, draws=draws)]
    for one, file in zip(made, files, strict=True):
        write_bvh(one.motion, file)
    if plot is not None:
        from ..plots import compare, save

        save(compare({file.stem: m.motion for file, m in zip(files, made, strict=True)}), plot)
    tell_saved(*files, plot)


def _synthesise_cell(
    trained: "Fit", levels: dict[str, str], seconds: float | None, bvh: Path, plot: Path | None
) -> None:
    """Make the segment of a combination of levels by a fit of the tensor."""
    from ..motion.io.bvh import write_bvh
    from ..tasks.segment_motion import synthesise_cell

    made = synthesise_cell(trained, levels, seconds)
    write_bvh(made, bvh)
    if plot is not None:
        from ..plots import compare, save

        save(compare({bvh.stem: made}), plot)
    tell_saved(bvh, plot)


def _labels(label: list[str] | None, subject: str | None, gait: str | None) -> dict[str, str]:
    """Join the long and the short ways to give labels."""
    texts = list(label or [])
    texts += [f"subject={subject}"] * (subject is not None)
    texts += [f"gait={gait}"] * (gait is not None)
    return pairs(texts, "--label")


def _require_all(fit: "Fit", levels: dict[str, str], moving: str | None = None) -> None:
    """Refuse labels of unknown factors, and factors without a label."""
    from ..tasks.synthesise import styles_of

    factors = styles_of(fit)
    names = [name for name in factors if name != moving]
    for name in levels:
        if name not in names:
            raise InputError(
                f"--label {name}", "the fit has no such factor", f"It has {', '.join(names)}"
            )
    for name in names:
        if name not in levels:
            known = ", ".join(factors[name])
            raise InputError(f"--label {name}", "it is missing", f"Give one of {known}")


def _numbered(path: Path, index: int) -> Path:
    """Give the name of a file, with a number from the second on."""
    return path if index == 0 else path.with_stem(f"{path.stem}-{index + 1}")


def tell_saved(*paths: Path | None) -> None:
    """Say what was written."""
    for path in paths:
        if path is not None:
            console.say(f"saved to {path}")
