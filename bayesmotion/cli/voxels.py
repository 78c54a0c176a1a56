"""The commands ``voxels``, ``fit voxel`` and ``recognize-pose``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import console
from ..errors import InputError
from .app import fits
from .fit_options import Files, Out, Rate, Seed, refuse_silent
from .predicting import tell_saved

if TYPE_CHECKING:
    from ..sensing.cameras import Camera

CAMERAS, RADIUS, HEIGHT = 6, 6.0, 1.6  # of the circle, in metres


def voxels(
    clip: Annotated[Path, typer.Argument(help="A recording: .amc, .bvh or a saved .nc.")],
    out: Annotated[Path, typer.Option(help="Where the voxels are saved (netCDF).")],
    cameras: Annotated[
        int | None, typer.Option(min=1, help=f"Cameras on a circle around; {CAMERAS}.")
    ] = None,
    first: Annotated[
        float | None, typer.Option(help="Degrees from +z to the first camera; 0.")
    ] = None,
    radius: Annotated[
        float | None, typer.Option(help=f"Of the circle, in metres; {RADIUS:g}.")
    ] = None,
    height: Annotated[
        float | None, typer.Option(help=f"Of the cameras, in metres; {HEIGHT:g}.")
    ] = None,
    camera_file: Annotated[
        Path | None,
        typer.Option(help="Calibrated cameras (JSON) in the recording's world, not on a circle."),
    ] = None,
    rate: Rate = 30.0,
    flips: Annotated[
        float, typer.Option(min=0.0, max=0.49, help="Share of the silhouettes' pixels gone wrong.")
    ] = 0.0,
    holes: Annotated[int, typer.Option(min=0, help="Holes in each silhouette.")] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise.")] = 0,
    plot: Annotated[Path | None, typer.Option(help="Draw some frames: .png, .pdf, .svg.")] = None,
) -> None:
    """Dress a recording in a body, see it from cameras, and carve voxels from the silhouettes.

    A voxel is a sixtieth of the height that the first frame shows.
    """
    from ..motion.recordings import at_rate, read_clip
    from ..sensing.cameras import circle, read_cameras
    from ..sensing.silhouettes import Noise
    from ..sensing.voxels import carve, hulls, save_voxels

    if camera_file is not None:
        refuse_silent(
            "beside --camera-file", cameras=cameras, first=first, radius=radius, height=height
        )
        around = read_cameras(camera_file)
    else:
        around = circle(
            cameras or CAMERAS,
            radius=RADIUS if radius is None else radius,
            height=HEIGHT if height is None else height,
            first=first or 0.0,
        )
    motion = at_rate(read_clip(clip), rate, "none")
    noise = Noise(flips=flips, holes=holes) if flips or holes else None
    frames = motion.sizes["frame"]
    with console.progress("voxels", frames, "frames") as progress:
        found = carve(
            motion, around, seed=seed, noise=noise, follow=camera_file is None, progress=progress
        )
    shells = [hull.shell for hull in hulls(found)]
    save_voxels(found, out)
    mean = found.sizes["count"] / frames
    skin = sum(map(len, shells)) / frames
    console.say(f"{frames} frames, {mean:.0f} voxels each, {skin:.0f} of them at the surface")
    if plot is not None:
        from ..plots import save
        from ..plots.voxels import voxel_figure

        chosen = [round(i * (frames - 1) / 4) for i in range(5)]
        titles = [f"{float(found['time'][i]):.2f} s" for i in chosen]
        save(voxel_figure([shells[i] for i in chosen], titles), plot)
    tell_saved(out, plot)


@fits.command("voxel")
def fit_voxel(
    files: Files,
    out: Out,
    rate: Rate = 30.0,
    seed: Seed = 0,
    components: Annotated[int, typer.Option(min=1, help="Of the mixture.")] = 200,
    cameras: Annotated[int, typer.Option(min=1, help="Cameras on a circle around.")] = CAMERAS,
) -> None:
    """Learn to recognise poses from voxels: silhouettes, descriptors, and a regression."""
    import numpy as np

    from ..models.joint_angles import angle_labels, angles_of
    from ..motion import split
    from ..motion.dataset import skeletons
    from ..motion.io import read
    from ..motion.recordings import at_rate
    from ..sensing.cameras import circle
    from ..sensing.voxels import carve, hulls
    from ..tasks.voxel_features import describe, joined
    from ..tasks.voxel_files import save_voxel_pose
    from ..tasks.voxel_pose import Settings, train

    motion = at_rate(read(*files), rate, "none")
    settings = Settings(components=components)
    skeleton = next(iter(skeletons(motion).values()))
    labels = angle_labels(skeleton)
    described, angles = [], []
    around: list[Camera] = circle(cameras)
    with console.progress("voxels", motion.sizes["frame"], "frames") as progress:
        done = 0
        for part in split(motion).values():
            shells = hulls(carve(part, around, seed=seed))
            described.append(describe(shells, settings.context, settings.cell))
            angles.append(angles_of(part, labels))
            done += part.sizes["frame"]
            progress(done)
    rest = {dof: float(np.nanmean(motion["angle"].sel(dof=dof))) for dof in skeleton.dofs}
    with console.progress("mixture", settings.mixture_steps) as progress:
        fit = train(
            joined(described), np.concatenate(angles), labels, settings, seed=seed,
            skeleton=skeleton, rest=rest, say=console.note, progress=progress,
        )  # fmt: skip
    save_voxel_pose(fit, out)
    kept, of = len(fit.regressor.relevant.kept), fit.regressor.of
    console.say(f"{kept} of {of} frames kept, {fit.seconds:.1f} seconds")
    tell_saved(out)


def recognize_pose(
    fit: Annotated[Path, typer.Argument(help="What `bayesmotion fit voxel` saved.")],
    hull: Annotated[Path, typer.Argument(help="Voxels, as `bayesmotion voxels` saved them.")],
    bvh: Annotated[Path | None, typer.Option(help="Write the poses as BVH.")] = None,
    clip: Annotated[
        Path | None, typer.Option(help="The recording the voxels are of, to tell the error.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write angles and standard deviations.")
    ] = None,
) -> None:
    """Recognise the pose in every frame of voxels.

    Without --clip tells how sure it is. In the BVH file the root is where the middle of the
    voxels is, and joints that are not recognised stand as they did on average in training.
    """
    import numpy as np

    from ..files import write_json
    from ..models.joint_angles import angles_of, posed, rms_degrees
    from ..motion.bvh import write_bvh
    from ..motion.recordings import at_rate, read_clip
    from ..sensing.voxels import hulls, load_voxels
    from ..tasks.voxel_features import describe
    from ..tasks.voxel_files import load_voxel_pose

    trained, seen = load_voxel_pose(fit), load_voxels(hull)
    settings, labels = trained.settings, trained.regressor.space.labels
    frames = seen.sizes["frame"]
    with console.progress("poses", frames, "frames") as progress:
        described = describe(hulls(seen), settings.context, settings.cell, progress)
    angles, spread = trained.recognise(described)
    console.say(f"{frames} frames, standard deviation {np.degrees(spread).mean():.1f} degrees")
    if clip is not None:
        motion = at_rate(read_clip(clip), float(seen.attrs["frame_rate"]), "none")
        if motion.sizes["frame"] != frames:
            raise InputError(clip, f"it has not the voxels' {frames} frames", "Give their clip")
        error = rms_degrees(angles_of(motion, labels), angles)
        console.say(f"error {error:.2f} degrees (root mean square, mean over {len(labels)} angles)")
    if json_file is not None:
        content = {"labels": labels, "angles": angles.tolist(), "spread": spread.tolist()}
        write_json(json_file, content)
    if bvh is not None:
        skeleton = trained.skeleton
        name = str(seen["clip"].values[0])
        root = voxel_middles(seen) / (skeleton.metres or 1.0)
        made = posed(
            angles, labels, skeleton, root, frame_rate=float(seen.attrs["frame_rate"]),
            clip=name, rest=dict(trained.rest),
        )  # fmt: skip
        write_bvh(made, bvh)
    tell_saved(bvh, json_file)


def voxel_middles(seen):
    """Give the middle of each frame's voxels, in metres."""
    import json

    import numpy as np

    from ..sensing.voxels import hulls

    (side,) = json.loads(seen.attrs["side"]).values()
    return np.array([(hull.voxels.mean(axis=0) + 0.5) * side for hull in hulls(seen)])
