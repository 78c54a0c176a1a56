"""Gait-pose models: the fit, ``reconstruct`` and ``filter``, and paths to ``synthesize``."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import console
from ..errors import InputError
from .app import Body, FrameRate, Joints
from .outputs import (
    Bvh,
    Drawn,
    FitFile,
    Json,
    Most,
    Picture,
    Table,
    check_drawn,
    samples_for,
    tell_saved,
    write_drawn,
)

if TYPE_CHECKING:
    import xarray as xr

    from ..fit import Fit
    from ..tasks.reconstruct import Reconstruction

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


def reconstruct(
    fit: FitFile,
    clip: Clip,
    missing: Missing = "",
    cycle: Which = 1,
    most: Most = 100,
    draws: Drawn = 0,
    out: Table = None,
    json_file: Json = None,
    bvh: Bvh = None,
    plot: Picture = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
    joints: Joints = None,
) -> None:
    """Fill in the limbs that were not measured, from the others.

    By a fit of gait_pose those of one gait cycle, on the body that all cycles are put on; by a
    fit of multifactor those of the clip as it is.

    Missing are the joints that --missing names, those that are NaN in the recording, and what
    hangs on them. What the recording holds for them is not looked at, but where a gait cycle
    has it and it does not stand still over the whole cycle it tells the error: a mean distance
    in millimetres on the body that all cycles are put on, beside that of baselines.
    """
    from ..motion.io.recordings import read_clip
    from ..tasks.reconstruct import reconstruct as reconstruct_of

    check_drawn(bvh, draws, [fit, clip])
    recorded = read_clip(clip, frame_rate=frame_rate, skeleton=skeleton, joints=joints)
    loaded, whole, names = _read(fit, clip, recorded, missing, cycle)
    samples = samples_for(loaded, draws, most)
    made = reconstruct_of(loaded, whole, names, cycle=cycle, draws=most, samples=samples)
    lost, result = _missing_joints(made), made.score
    console.say(f"filled in {', '.join(lost)}")
    if result is not None and result.error_mm is not None:
        others = ", ".join(
            f"{name.replace('_', ' ')} {error:.1f}" for name, error in result.baselines_mm.items()
        )
        console.say(f"mean error {result.error_mm:.1f} mm; baselines: {others} mm")
    if result is not None and result.coverage90 is not None:
        console.say(f"the 90 % interval held {result.coverage90:.1%} of the missing angles")
    if result is not None and result.why is not None:
        kind = "no error" if result.error_mm is None else "not judged"
        console.say(f"{kind}: {result.why}")
    figures = {"missing": lost, **({} if result is None else asdict(result))}
    _write(made, lost, "reconstructed", figures, draws, out, json_file, bvh, plot)


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
    most: Most = 100,
    out: Table = None,
    json_file: Json = None,
    bvh: Bvh = None,
    plot: Picture = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
    joints: Joints = None,
) -> None:
    """Take the noise out of a gait cycle.

    Joints that --missing names or that are NaN in the recording are filled in, as by
    reconstruct.
    """
    import numpy as np

    from ..motion.io.recordings import read_clip
    from ..tasks.gait import cycles_of
    from ..tasks.reconstruct import denoise_cycle

    recorded = read_clip(clip, frame_rate=frame_rate, skeleton=skeleton, joints=joints)
    loaded, whole, names = _read(fit, clip, recorded, missing, cycle)
    made = denoise_cycle(loaded, whole, names, noise=noise, cycle=cycle, draws=most)
    assert made.noise is not None
    assert made.features is not None
    lost, encoding = _missing_joints(made), cycles_of(loaded).encoding
    apart = np.linalg.norm(
        encoding.positions(made.mean) - encoding.positions(made.features), axis=-1
    )
    moved = float(apart[np.isfinite(apart)].mean())
    known = "estimated" if noise is None else "given"
    console.say(f"noise of {100 * made.noise:.3g} % of the motion ({known})")
    console.say(f"joints were moved by {moved:.1f} mm in the mean")
    if lost:
        console.say(f"filled in {', '.join(lost)}")
    figures = {"level": made.noise, "moved_mm": moved, "missing": lost}
    _write(made, lost, "filtered", figures, 0, out, json_file, bvh, plot)


def synthesise_path(
    fit: "Fit", path: str, seconds: float | None, bvh: Path, plot: Path | None,
    json_file: Path | None,
) -> None:  # fmt: skip
    """Write the walk along a path on a fit's surface, one cycle a second."""
    from ..files import write_json
    from ..motion.cycles import RATE
    from ..motion.io.bvh import write_bvh
    from ..tasks.cautions import cautions, warn
    from ..tasks.gait import along, paths, trained_of

    trained = trained_of(fit)
    turns = 2.0 if seconds is None else seconds
    found = {name.replace(" ", "-"): at for name, at in paths(trained, int(RATE), turns).items()}
    if path not in found:
        raise InputError(f"--path {path}", "there is no such path", f"Use {', '.join(found)}")
    poses = along(trained, **found[path])
    made = trained.training.encoding.motion(poses.means(), path)
    messages = cautions(fit)
    warn("the motion", messages)
    write_bvh(made, bvh)
    if json_file is not None:
        frames = {"path": path, "frames": made.sizes["frame"], "frame_rate": RATE}
        write_json(json_file, {**frames, "messages": list(messages), "file": str(bvh)})
    if plot is not None:
        from ..plots import compare, save

        save(compare({path: made}), plot)
    tell_saved(bvh, json_file, plot)


def _read(
    fit: Path, clip: Path, recorded: "xr.Dataset", missing: str, number: int
) -> "tuple[Fit, xr.Dataset, list[str]]":
    """Return a fit, the clip as it takes it, and the joints said to be missing.

    Limbs at rest are warned of.
    """
    from ..fit import load
    from ..tasks.gait import cycles_of, joints_named
    from ..tasks.incomplete import incomplete_cycle
    from ..verbs import ConditionsOnCycles

    loaded = load(fit)
    names = [name.strip() for name in missing.split(",") if name.strip()]
    if not isinstance(loaded.model, ConditionsOnCycles):
        return loaded, recorded, names
    training = cycles_of(loaded)
    found = incomplete_cycle(
        recorded, training.poses, number, joints_named(training.encoding, names)
    )
    for limb in found.limbs_at_rest:
        console.note(
            f"warning: {clip}: {limb} is at rest over the whole cycle. If it was not measured, "
            f"say --missing {','.join([*names, limb])}"
        )
    return loaded, recorded, names


def _missing_joints(made: "Reconstruction") -> list[str]:
    """Return the joints of which something is missing in what was given."""
    lost = made.given["angle"].isnull().any("frame")
    dofs = [str(dof) for dof in lost["dof"].values[lost.values]]
    return list(dict.fromkeys(dof.split("/")[0] for dof in dofs))


def _write(
    made: "Reconstruction", lost: list[str], name: str, figures: dict[str, Any], draws: int,
    out: Path | None, json_file: Path | None, bvh: Path | None, plot: Path | None,
) -> None:  # fmt: skip
    """Write what was asked for and say so."""
    from ..files import write_json
    from ..motion.dataset import clips
    from ..motion.io.bvh import write_bvh
    from ..motion.io.reading import write

    if out is not None:
        write(made, out)
    if json_file is not None:
        cycle = clips(made.given)[0]
        write_json(json_file, {"cycle": cycle, **figures, "messages": list(made.messages)})
    drawn = []
    if bvh is not None:
        write_bvh(made.motion, bvh)
        drawn = write_drawn(bvh, made.draws(draws) if draws else [])
    if plot is not None:
        from ..plots import compare, save

        save(compare({"given": made.given, name: made.motion}, made_up={name: lost}), plot)
    tell_saved(out, json_file, bvh, *drawn, plot)
