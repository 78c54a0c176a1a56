"""The command ``synthesize``, and what commands on fits share."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from ..files import BVH, check_outputs, write_json
from ..seeds import MAX_SEED
from .app import pairs
from .outputs import (
    Drawn,
    FitFile,
    Json,
    Most,
    Picture,
    Table,
    drawn_files,
    samples_for,
    tell_saved,
    write_drawn,
)

if TYPE_CHECKING:
    import xarray as xr

    from ..fit import Fit
    from ..motion.resampling import Filter

Label = Annotated[
    list[str] | None, typer.Option(help="factor=level, as often as there are factors.")
]
Subject = Annotated[str | None, typer.Option(help="Short for --label subject=...")]
Gait = Annotated[str | None, typer.Option(help="Short for --label gait=...")]


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
    most: Most = 100,
    draws: Drawn = 0,
    path: Annotated[
        str | None,
        typer.Option(help="Of a gait_pose fit, on its surface: line, inner-spiral, outer-spiral."),
    ] = None,
    out: Table = None,
    json_file: Json = None,
    plot: Picture = None,
) -> None:
    """Make a motion nobody recorded: of any combination of the levels that were learned.

    It is the mean over the draws of the fit; --out writes how sure that is, --draws motions
    that are drawn.

    With --transition one factor changes on the way; with --sample the styles are drawn at
    random and the files are numbered from the second on. A gait_pose fit walks along a --path
    on its surface.
    """
    from ..fit import load
    from ..motion.io.bvh import write_bvh
    from ..motion.io.reading import write
    from ..tasks import synthesise
    from ..verbs import ConditionsOnCycles, PredictsCells

    levels = labels_of(label, subject, gait)
    if sample is not None and (levels or transition):
        raise InputError("--sample", "styles are drawn at random", "Leave out labels")
    files = [_numbered(bvh, i) for i in range(sample or 1)]
    beside = [path for file in files for path in drawn_files(file, draws)]
    check_outputs([(path, BVH) for path in (*files, *beside)], [fit])
    trained = load(fit)
    if path is not None:
        from .gait import synthesise_path

        if levels or sample is not None or transition is not None:
            raise InputError("--path", "a path on a surface has no labels", "Leave them out")
        _refuse_spread("a path", out, draws)
        synthesise_path(trained, path, seconds, bvh, plot, json_file)
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
        _refuse_spread("a segment of the tensor", out, draws)
        _synthesise_cell(trained, levels, seconds, bvh, plot, json_file)
        return
    seconds = 5.0 if seconds is None else seconds
    if sample is not None and out is not None:
        raise InputError("--out", "a table holds one motion", "Leave out --sample")
    how = {"draws": most, "samples": samples_for(trained, draws, most) if draws else 0}
    if sample is not None:
        made = [synthesise.sampled(trained, seconds, seed + i, **how) for i in range(sample)]
    elif transition is not None:
        ((factor, way),) = pairs([transition], "--transition").items()
        stations = tuple(way.split(","))
        if len(stations) < 2 or factor in levels:
            raise InputError(
                "--transition", f"{transition!r} is no way", f"Write {factor}=a,b and no --{factor}"
            )
        _require_all(trained, levels, factor)
        made = [synthesise.transition(trained, levels, factor, stations, seconds, **how)]
    else:
        _require_all(trained, levels)
        made = [synthesise.synthesize(trained, levels, seconds, **how)]
    drawn = []
    for one, file in zip(made, files, strict=True):
        write_bvh(one.motion, file)
        drawn += write_drawn(file, one.draws(draws) if draws else [])
    if out is not None:
        write(made[0], out)
    _write_told([_told(one.motion, list(one.messages)) for one in made], files, drawn, json_file)
    if plot is not None:
        from ..plots import compare, save

        save(compare({file.stem: m.motion for file, m in zip(files, made, strict=True)}), plot)
    tell_saved(*files, *drawn, out, json_file, plot)


def _told(motion: "xr.Dataset", messages: list[str]) -> dict:
    """Return what is to be said of a motion, as plain values."""
    from ..motion.dataset import clips, label_names

    frames, rate = motion.sizes["frame"], float(motion.attrs["frame_rate"])
    labels = {name: str(motion[name].values[0]) for name in label_names(motion)}
    labels = {name: text for name, text in labels.items() if text}
    return {"clip": clips(motion)[0], "labels": labels, "frames": frames,
            "frame_rate": rate, "messages": messages}  # fmt: skip


def _write_told(
    told: list[dict], files: Sequence[Path], drawn: Sequence[Path], path: Path | None
) -> None:
    """Write what is to be said of motions, and where they are."""
    if path is not None:
        rows = [{**one, "file": str(file)} for one, file in zip(told, files, strict=True)]
        write_json(path, {"motions": rows, "draws": [str(file) for file in drawn]})


def _refuse_spread(what: str, out: Path | None, draws: int) -> None:
    """Refuse uncertainty of what is made without."""
    if out is not None or draws:
        raise InputError("--out, --draws", f"{what} is made as its mean alone", "Leave them out")


def _synthesise_cell(
    trained: "Fit", levels: dict[str, str], seconds: float | None, bvh: Path, plot: Path | None,
    json_file: Path | None,
) -> None:  # fmt: skip
    """Make the segment of a combination of levels by a fit of the tensor."""
    from ..motion.io.bvh import write_bvh
    from ..tasks.cautions import cautions, warn
    from ..tasks.segment_motion import synthesise_cell

    warn("the motion", cautions(trained))

    made = synthesise_cell(trained, levels, seconds)
    write_bvh(made, bvh)
    if plot is not None:
        from ..plots import compare, save

        save(compare({bvh.stem: made}), plot)
    _write_told([_told(made, list(cautions(trained)))], [bvh], [], json_file)
    tell_saved(bvh, json_file, plot)


def labels_of(label: list[str] | None, subject: str | None, gait: str | None) -> dict[str, str]:
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
