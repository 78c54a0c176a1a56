"""Gait-pose models: the fit, ``reconstruct`` and ``filter``, and paths to ``synthesize``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import console
from ..errors import InputError
from ..intervals import NINETY
from .app import fits, require_model
from .fit_options import Drop, Files, Out, Seed, refuse_silent
from .predicting import Bvh, FitFile, Picture, tell_saved

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from ..fit import Fit
    from ..tasks.gait import Trained
    from ..tasks.pose_posterior import Pose

SWEEPS, STEPS = 40, 1000
Clip = Annotated[Path, typer.Argument(help="A recording of somebody walking.")]
Which = Annotated[
    int, typer.Option(min=1, help="Which of the clip's straight gait cycles, from 1 on.")
]
Json = Annotated[Path | None, typer.Option("--json", help="Write the figures.")]


@fits.command("gait-pose")
def fit_gait(
    files: Files,
    out: Out,
    variant: Annotated[
        str,
        typer.Option(
            help="torus1, torus3, cylinder3: points around a surface, learned locally; on_torus1, "
            "on_torus3, on_cylinder3: points on it; ll_gpdm, gpdm, gplvm."
        ),
    ] = "torus3",
    most: Annotated[
        int, typer.Option(min=1, help="Cycles taken of each file, the straightest ones.")
    ] = 3,
    sweeps: Annotated[
        int | None,
        typer.Option(
            min=1, help=f"Of variants learned locally: how often the surface is covered; {SWEEPS}."
        ),
    ] = None,
    max_steps: Annotated[
        int | None,
        typer.Option(min=1, help=f"Of all others: at most so many steps of the search; {STEPS}."),
    ] = None,
    seed: Seed = 0,
    drop: Drop = False,
) -> None:
    """Fit a gait-pose model to the straight gait cycles of recordings of people walking."""
    from ..inference.local import fit_local
    from ..inference.map import fit_map
    from ..models.gait_pose import LAYERS, VARIANTS
    from ..motion.cycles import cycles_of
    from ..motion.dataset import clips
    from ..motion.io import read as reading
    from ..motion.joining import concat
    from ..tasks.gait import with_deviation
    from .recordings import looked_over

    if variant not in VARIANTS:
        raise InputError(
            f"--variant {variant}", "there is no such variant", f"Use {', '.join(VARIANTS)}"
        )
    model, preparation = VARIANTS[variant], {"scales": list(LAYERS[variant])}
    # Only points that are free around a surface can be learned by patches.
    locally = not (model.dynamics or model.on or model.surface == "none")
    if locally:
        refuse_silent(f"to {variant}, which is learned locally", max_steps=max_steps)
    else:
        refuse_silent(f"to {variant}, which is not learned locally", sweeps=sweeps)
    read = [looked_over(reading(path), dropping=drop) for path in files]
    motion = concat([cycles_of(one, most) for one in read])
    console.note(f"{len(clips(motion))} gait cycles")
    if locally:
        sweeps = sweeps or SWEEPS
        with console.progress("fit", sweeps, "sweeps") as progress:
            result = fit_local(
                model, motion, seed=seed, sweeps=sweeps, preparation=preparation,
                progress=progress,
            )  # fmt: skip
    else:
        max_steps = max_steps or STEPS
        with console.progress("fit", max_steps) as progress:
            result = fit_map(
                model, motion, seed=seed, starts=1, keep=1, max_steps=max_steps,
                preparation=preparation, progress=progress,
            )  # fmt: skip
    console.note("leaving people out, to learn how new ones differ")
    result = with_deviation(result)
    result.save(out)
    seconds, best = float(result.tree.attrs["seconds"]), result.stats()["lp"]
    console.say(f"{variant} of {len(clips(motion))} cycles: {seconds:.1f} seconds, "
                f"log density {best:.2f}")  # fmt: skip
    console.say(f"saved to {out}")


def reconstruct(
    fit: FitFile,
    clip: Clip,
    missing: Annotated[
        str, typer.Option(help="Limbs (larm, rarm, lleg, rleg) or joints, with commas.")
    ],
    cycle: Which = 1,
    json_file: Json = None,
    bvh: Bvh = None,
    plot: Picture = None,
) -> None:
    """Fill in the limbs of a gait cycle that were not measured, from the others.

    What the recording holds for them is not looked at, but told as the error where it is
    there: a mean distance in millimetres on the body that all cycles are put on.
    """
    import numpy as np

    from ..tasks.gait import limb_columns, moved_joints
    from ..tasks.gait import reconstruct as reconstruct_of

    trained, motion, u = _cycle(fit, clip, cycle)
    columns = limb_columns(trained, [name.strip() for name in missing.split(",")])
    pose = reconstruct_of(trained, u, columns)
    encoding = trained.training.encoding
    joints = moved_joints(columns)
    apart = np.linalg.norm(encoding.positions(pose.mean) - encoding.positions(u), axis=-1)
    inside = np.abs(pose.mean - u)[:, columns] <= NINETY * pose.sd[:, columns]
    figures: dict[str, Any] = {"missing": missing, "coverage90": float(inside.mean())}
    if joints:
        figures["error_mm"] = float(apart[:, joints].mean())
        console.say(f"mean error {figures['error_mm']:.1f} mm")
    console.say(f"the 90 % interval held {inside.mean():.1%} of the missing angles")
    _write(trained, motion, pose, "reconstructed", figures, json_file, bvh, plot)


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
    cycle: Which = 1,
    json_file: Json = None,
    bvh: Bvh = None,
    plot: Picture = None,
) -> None:
    """Take the noise out of a gait cycle."""
    import numpy as np

    from ..tasks.gait import denoise

    trained, motion, u = _cycle(fit, clip, cycle)
    pose, level = denoise(trained, u, noise)
    encoding = trained.training.encoding
    apart = np.linalg.norm(encoding.positions(pose.mean) - encoding.positions(u), axis=-1)
    known = "estimated" if noise is None else "given"
    console.say(f"noise of {100 * level:.3g} % of the motion ({known})")
    console.say(f"joints were moved by {apart.mean():.1f} mm in the mean")
    figures = {"level": level, "moved_mm": float(apart.mean())}
    _write(trained, motion, pose, "filtered", figures, json_file, bvh, plot)


def synthesise_path(
    fit: "Fit", path: str, seconds: float | None, bvh: Path, plot: Path | None
) -> None:
    """Write the walk along a path on a fit's surface, one cycle a second."""
    from ..motion.bvh import write_bvh
    from ..motion.cycles import RATE
    from ..tasks.gait import along, paths, trained_of

    trained = trained_of(fit)
    turns = 2.0 if seconds is None else seconds
    found = {name.replace(" ", "-"): at for name, at in paths(trained, int(RATE), turns).items()}
    if path not in found:
        raise InputError(f"--path {path}", "there is no such path", f"Use {', '.join(found)}")
    mean, _ = along(trained, **found[path])
    made = trained.training.encoding.motion(mean, path)
    write_bvh(made, bvh)
    if plot is not None:
        from ..plots import compare, save

        save(compare({path: made}), plot)
    tell_saved(bvh, plot)


def _cycle(
    fit: Path, clip: Path, number: int
) -> "tuple[Trained, xr.Dataset, np.ndarray[Any, Any]]":
    """Read a fit and one cycle of a clip: its motion and its features."""
    from .. import fit as fits
    from ..models.gait_pose import GaitPose
    from ..motion.cycles import cycles_of
    from ..motion.joining import split
    from ..tasks.gait import trained_of
    from .recordings import one_clip

    loaded = fits.load(fit)
    require_model(loaded.model, fit, GaitPose.name)
    poses = loaded.training.poses
    parts = list(split(cycles_of(one_clip(clip), poses=poses)).values())
    if number > len(parts):
        raise InputError(
            f"--cycle {number}", f"{clip} has {len(parts)} straight cycles", "Take one of those"
        )
    trained = trained_of(loaded)
    return trained, parts[number - 1], trained.training.encoding.scaled(parts[number - 1])


def _write(
    trained: "Trained",
    motion: "xr.Dataset",
    pose: "Pose",
    name: str,
    figures: dict[str, Any],
    json_file: Path | None,
    bvh: Path | None,
    plot: Path | None,
) -> None:
    """Write what was asked for and say so."""
    from ..files import write_json
    from ..motion.bvh import write_bvh

    made = trained.training.encoding.motion(pose.mean, f"{motion['clip'].values[0]} {name}")
    if json_file is not None:
        write_json(json_file, {"cycle": str(motion["clip"].values[0]), **figures})
    if bvh is not None:
        write_bvh(made, bvh)
    if plot is not None:
        from ..plots import compare, save

        save(compare({"recorded": motion, name: made}), plot)
    tell_saved(json_file, bvh, plot)
