"""The commands ``keyposes`` and ``recognize``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import console
from ..errors import InputError
from ..files import PROBABILITIES
from .app import Body, FrameRate, Joints
from .outputs import Bvh, FitFile, Json, Most, Picture, tell_saved

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

WEIGHTS = ("equal", "masses")


def keyposes(
    clip: Annotated[Path, typer.Argument(help="A recording: .amc, .bvh or a saved .nc.")],
    music: Annotated[Path | None, typer.Option(help="Sound file whose beats are tracked.")] = None,
    beats: Annotated[
        Path | None, typer.Option(help="Text file of beats: seconds, one a line.")
    ] = None,
    tempo: Annotated[float | None, typer.Option(help="Even beats, so many a minute.")] = None,
    offset: Annotated[
        float, typer.Option(help="Seconds of the music at the clip's first frame.")
    ] = 0.0,
    low: Annotated[
        float | None, typer.Option(help="T_1: energy that is low enough; the lower quartile.")
    ] = None,
    deep: Annotated[
        float | None, typer.Option(help="T_2: depth that is enough; the median.")
    ] = None,
    weights: Annotated[
        str, typer.Option(help="Of joints in the energy: equal, or masses of the body's segments.")
    ] = "equal",
    dimensions: Annotated[
        int | None, typer.Option(min=1, help="With --bvh: dimensions of the motion written.")
    ] = None,
    json_file: Json = None,
    bvh: Bvh = None,
    plot: Picture = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
    joints: Joints = None,
) -> None:
    """Find a dance's keyposes: minima of the energy flow near the beats of its music.

    Beats come from --music, --beats or --tempo. Without --low and --deep the thresholds are
    those of the clip's own minima. --bvh writes the motion in the space of the first
    --dimensions components of its keyposes.
    """
    if weights not in WEIGHTS:
        raise InputError(f"--weights {weights}", "there are no such weights", "Use equal or masses")
    if (bvh is None) != (dimensions is None):
        raise InputError("--bvh, --dimensions", "one is given without the other", "Give both")
    from ..files import write_json
    from ..models.keyposes.flows import flows_of
    from ..motion.dataset import skeleton_of
    from ..motion.io.recordings import read_clip
    from ..motion.masses import joint_masses
    from ..tasks.keyposes import keyposes_of

    motion = read_clip(clip, frame_rate=frame_rate, skeleton=skeleton, joints=joints)
    rate = float(motion.attrs["frame_rate"])
    seconds = (motion.sizes["frame"] - 1) / rate
    times = _beats(music, beats, tempo, seconds, offset)
    times = times[(times >= 0) & (times <= seconds)]
    weight = joint_masses(skeleton_of(motion)) if weights == "masses" else None
    found, in_global, in_body = keyposes_of(
        motion, times, low=low, deep=deep, weight=weight
    )  # fmt: skip
    console.table(
        f"{len(found.frame)} keyposes at {len(in_global.frame)} beats",
        ["frame", "seconds", "beat", "seen in", "energy", "depth"],
        [
            (int(f), float(f / rate), int(b), source, float(m.energy[b]), float(m.depth[b]))
            for f, b, source in zip(found.frame, found.beat, found.source, strict=True)
            for m in (in_global if source == "global" else in_body,)
        ],
    )
    if json_file is not None:
        rows = [
            {"frame": int(f), "seconds": float(f / rate), "beat": int(b), "source": source}
            for f, b, source in zip(found.frame, found.beat, found.source, strict=True)
        ]
        write_json(json_file, {"beats": times.tolist(), "keyposes": rows})
    if bvh is not None and dimensions is not None:
        from ..motion.io.bvh import write_bvh
        from ..tasks.low_dimensional import low_dimensional

        write_bvh(low_dimensional(motion, found.frame, dimensions), bvh)
    if plot is not None:
        from ..plots import keyposes_plot, save

        save(keyposes_plot(motion, flows_of(motion, weight), times, found), plot)
    tell_saved(json_file, bvh, plot)


def recognize(
    fit: FitFile,
    clips: Annotated[list[Path], typer.Argument(help="Recordings, each a segment.")],
    p_new: Annotated[
        float,
        typer.Option(
            min=0.001, max=0.999, help="Probability beforehand that a person or a task is new."
        ),
    ] = 0.5,
    most: Most = 100,
    out: Annotated[
        Path | None,
        typer.Option(help="Write probabilities of all levels as .csv or .nc."),
        PROBABILITIES,
    ] = None,
    json_file: Json = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Say who moves and what they do, with probabilities, by a fit of the motion tensor.

    Probabilities are calibrated by leaving people, tasks and repetitions out of the training
    clips. A level is called new where that is more probable than not.
    """
    from ..files import write_json
    from ..fit import load
    from ..motion.io.reading import read
    from ..motion.io.recordings import given
    from ..tasks.recognize import recognize as recognized

    trained = load(fit)
    recorded = read(*clips, **given(frame_rate=frame_rate, skeleton=skeleton))
    found = recognized(trained, recorded, most, p_new=p_new)
    modes = [str(name).removeprefix("p_") for name in found.data_vars]
    answers = _answers(found, modes)
    columns = ["clip"]
    for mode in modes:
        columns += [mode, "p", f"p(new {mode})"]
    rows = []
    for clip, row in answers.items():
        cells: list[object] = [clip]
        for mode in modes:
            one = row[mode]
            cells += ["none of these" if one["new"] else one["named"], one["p"], one["p_new"]]
        rows.append(cells)
    console.table("Recognised", columns, rows)
    if json_file is not None:
        write_json(json_file, {"p_new": p_new, "clips": answers})
    if out is not None:
        _write_probabilities(found, modes, out)
    tell_saved(out, json_file)


def _write_probabilities(found: "xr.Dataset", modes: list[str], out: Path) -> None:
    """Write the probability of every level: netCDF, or a line a clip, factor and level."""
    import pandas as pd

    from ..files import replacing
    from ..netcdf import write_netcdf

    if out.suffix.lower() == ".nc":
        write_netcdf(out, found)
        return
    rows = [
        {"clip": clip, "factor": mode, "level": level, "p": float(p)}
        for mode in modes
        for clip, each in zip(found["clip"].values, found[f"p_{mode}"].values, strict=True)
        for level, p in zip(found[mode].values, each, strict=True)
    ]
    with replacing(out) as temporary:
        pd.DataFrame(rows).to_csv(temporary, index=False, float_format="%.6g")


def _beats(
    music: Path | None, beats: Path | None, tempo: float | None, seconds: float, offset: float
) -> "np.ndarray":
    """Give beats in seconds from the clip's first frame, by the one way that was chosen."""
    from ..sensing.audio.beats import even_beats, read_beats, track_beats

    ways = {"--music": music, "--beats": beats, "--tempo": tempo}
    given = [name for name, value in ways.items() if value is not None]
    if len(given) != 1:
        raise InputError(
            ", ".join(given) or "beats", "there is not one source of beats",
            "Give one of --music, --beats and --tempo",
        )  # fmt: skip
    if music is not None:
        return track_beats(music) - offset
    if beats is not None:
        return read_beats(beats) - offset
    assert tempo is not None
    return even_beats(tempo, seconds + max(offset, 0.0)) - offset


def _answers(found: "xr.Dataset", modes: list[str]) -> dict[str, dict]:
    """Give for every clip and mode the likeliest known level, and whether it is new."""
    from ..tasks.recognize import NEW, best_levels

    clips = found["clip"].values.tolist()
    answers: dict[str, dict] = {clip: {} for clip in clips}
    for mode in modes:
        p = found[f"p_{mode}"]
        for row, (clip, named) in enumerate(zip(clips, best_levels(found, mode), strict=True)):
            p_new = float(p.sel({mode: NEW}).values[row])
            answers[clip][mode] = {
                "named": named,
                "p": float(p.sel({mode: named}).values[row]),
                "p_new": p_new,
                "new": p_new > 0.5,
            }
    return answers
