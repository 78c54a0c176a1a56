"""Gait-pose models: the fit, ``reconstruct`` and ``filter``, and paths to ``synthesize``."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import console
from ..errors import InputError
from ..files import JSON
from .app import Body, FrameRate
from .predicting import Bvh, FitFile, Picture, tell_saved

if TYPE_CHECKING:
    import xarray as xr

    from ..fit import Fit
    from ..prediction import Mixture
    from ..tasks.gait import Trained
    from ..tasks.incomplete import Incomplete

SWEEPS, STEPS = 40, 1000
Clip = Annotated[Path, typer.Argument(help="A recording of somebody walking.")]
Which = Annotated[
    int, typer.Option(min=1, help="Which of the clip's straight gait cycles, from 1 on.")
]
Missing = Annotated[
    str,
    typer.Option(
        help="Limbs (larm, rarm, lleg, rleg) or joints, with commas, that are missing beside "
        "those that are NaN in the recording."
    ),
]
Json = Annotated[Path | None, typer.Option("--json", help="Write the figures."), JSON]


def reconstruct(
    fit: FitFile,
    clip: Clip,
    missing: Missing = "",
    cycle: Which = 1,
    json_file: Json = None,
    bvh: Bvh = None,
    plot: Picture = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Fill in the limbs of a gait cycle that were not measured, from the others.

    Missing are the joints that --missing names, those that are NaN in the recording, and what
    hangs on them. What the recording holds for them is not looked at, but where it is there and
    does not stand still over the whole cycle it tells the error: a mean distance in millimetres
    on the body that all cycles are put on, beside that of baselines.
    """
    from ..motion.io.recordings import read_clip
    from ..tasks.gait import reconstruct as reconstruct_of
    from ..tasks.incomplete import missing_joints, score

    recorded = read_clip(clip, frame_rate=frame_rate, skeleton=skeleton)
    trained, found = _cycle(fit, clip, recorded, cycle, missing)
    encoding = trained.training.encoding
    u = encoding.scaled(found.motion)
    lost = missing_joints(trained, u)
    if not lost:
        raise InputError(clip, "nothing is missing in it", "Name joints or limbs with --missing")
    pose = reconstruct_of(trained, u)
    result = score(trained, u, pose, encoding.scaled(found.truth), found.still)
    console.say(f"filled in {', '.join(lost)}")
    if result.error_mm is not None:
        others = ", ".join(
            f"{name.replace('_', ' ')} {error:.1f}" for name, error in result.baselines_mm.items()
        )
        console.say(f"mean error {result.error_mm:.1f} mm; baselines: {others} mm")
    if result.coverage90 is not None:
        console.say(f"the 90 % interval held {result.coverage90:.1%} of the missing angles")
    if result.why is not None:
        kind = "no error" if result.error_mm is None else "not judged"
        console.say(f"{kind}: {result.why}")
    figures = {"missing": lost, **asdict(result)}
    _write(trained, found, pose, "reconstructed", figures, json_file, bvh, plot)


def filter(
    fit: FitFile,
    clip: Clip,
    noise: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Standard deviation of the noise in that of the motion; estimated if not given.",
        ),
    ] = None,
    missing: Missing = "",
    cycle: Which = 1,
    json_file: Json = None,
    bvh: Bvh = None,
    plot: Picture = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Take the noise out of a gait cycle.

    Joints that --missing names or that are NaN in the recording are filled in, as by
    reconstruct.
    """
    import numpy as np

    from ..motion.io.recordings import read_clip
    from ..tasks.gait import denoise
    from ..tasks.incomplete import missing_joints

    recorded = read_clip(clip, frame_rate=frame_rate, skeleton=skeleton)
    trained, found = _cycle(fit, clip, recorded, cycle, missing)
    encoding = trained.training.encoding
    u = encoding.scaled(found.motion)
    lost = missing_joints(trained, u)
    pose, level = denoise(trained, u, noise)
    apart = np.linalg.norm(encoding.positions(pose.means()) - encoding.positions(u), axis=-1)
    moved = float(apart[np.isfinite(apart)].mean())
    known = "estimated" if noise is None else "given"
    console.say(f"noise of {100 * level:.3g} % of the motion ({known})")
    console.say(f"joints were moved by {moved:.1f} mm in the mean")
    if lost:
        console.say(f"filled in {', '.join(lost)}")
    figures = {"level": level, "moved_mm": moved, "missing": lost}
    _write(trained, found, pose, "filtered", figures, json_file, bvh, plot)


def synthesise_path(
    fit: "Fit", path: str, seconds: float | None, bvh: Path, plot: Path | None
) -> None:
    """Write the walk along a path on a fit's surface, one cycle a second."""
    from ..motion.cycles import RATE
    from ..motion.io.bvh import write_bvh
    from ..tasks.gait import along, paths, trained_of

    trained = trained_of(fit)
    turns = 2.0 if seconds is None else seconds
    found = {name.replace(" ", "-"): at for name, at in paths(trained, int(RATE), turns).items()}
    if path not in found:
        raise InputError(f"--path {path}", "there is no such path", f"Use {', '.join(found)}")
    poses = along(trained, **found[path])
    made = trained.training.encoding.motion(poses.means(), path)
    write_bvh(made, bvh)
    if plot is not None:
        from ..plots import compare, save

        save(compare({path: made}), plot)
    tell_saved(bvh, plot)


def _cycle(
    fit: Path, clip: Path, recorded: "xr.Dataset", number: int, missing: str
) -> "tuple[Trained, Incomplete]":
    """Read a fit and one cycle of a clip, without the joints that are said to be missing."""
    from ..fit import load
    from ..tasks.gait import cycles_of, joints_named, trained_of
    from ..tasks.incomplete import incomplete_cycle

    loaded = load(fit)
    training = cycles_of(loaded)
    names = [name.strip() for name in missing.split(",") if name.strip()]
    found = incomplete_cycle(
        recorded,
        training.poses,
        number,
        joints_named(training.encoding, names),
    )
    for limb in found.limbs_at_rest:
        console.note(
            f"warning: {clip}: {limb} is at rest over the whole cycle. If it was not measured, "
            f"say --missing {','.join([*names, limb])}"
        )
    return trained_of(loaded), found


def _write(
    trained: "Trained",
    found: "Incomplete",
    pose: "Mixture",
    name: str,
    figures: dict[str, Any],
    json_file: Path | None,
    bvh: Path | None,
    plot: Path | None,
) -> None:
    """Write what was asked for and say so."""
    from ..files import write_json
    from ..motion.io.bvh import write_bvh

    cycle = str(found.motion["clip"].values[0])
    made = trained.training.encoding.motion(pose.means(), f"{cycle} {name}")
    if json_file is not None:
        write_json(json_file, {"cycle": cycle, **figures})
    if bvh is not None:
        write_bvh(made, bvh)
    if plot is not None:
        from ..plots import compare, save

        save(compare({"given": found.motion, name: made}), plot)
    tell_saved(json_file, bvh, plot)
