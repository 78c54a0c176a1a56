"""The commands ``voxels``, ``fit voxel-pose`` and ``recognize-pose``."""

from pathlib import Path
from typing import Annotated

import typer

from .. import console
from ..errors import InputError
from ..files import BVH, PICTURE, VOXELS
from ..seeds import MAX_SEED
from .app import Body, FrameRate, refuse_silent
from .outputs import SAVED_FIT, Json, Most, Table, tell_saved

CAMERAS, RADIUS, HEIGHT = 6, 6.0, 1.6  # of the circle, in metres
EM_STEPS = 25  # of the mixture, at most


def voxels(
    clip: Annotated[Path, typer.Argument(help="A recording: .amc, .bvh or a saved .nc.")],
    out: Annotated[Path, typer.Option(help="Where the voxels are saved (netCDF)."), VOXELS],
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
    rate: Annotated[
        float, typer.Option(help="Frames a second; must divide that of the files.")
    ] = 30.0,
    flips: Annotated[
        float, typer.Option(min=0.0, max=0.49, help="Share of the silhouettes' pixels gone wrong.")
    ] = 0.0,
    holes: Annotated[int, typer.Option(min=0, help="Holes in each silhouette.")] = 0,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Of the noise.")] = 0,
    json_file: Json = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw some frames: .png, .pdf, .svg."), PICTURE
    ] = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Dress a recording in a body, see it from cameras, and carve voxels from the silhouettes.

    A voxel is a sixtieth of the height that the first frame shows.
    """
    from ..files import write_json
    from ..motion.io.recordings import read_clip, resampled
    from ..sensing.voxels.cameras import circle, read_cameras
    from ..sensing.voxels.carving import carve, hulls, save_voxels
    from ..sensing.voxels.silhouettes import Noise

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
    motion = resampled(read_clip(clip, frame_rate=frame_rate, skeleton=skeleton), rate)
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
    if json_file is not None:
        write_json(json_file, {"frames": frames, "cameras": len(around), "voxels": mean,
                               "surface": skin, "file": str(out)})  # fmt: skip
    if plot is not None:
        from ..plots import save
        from ..plots.voxels import voxel_figure

        chosen = [round(i * (frames - 1) / 4) for i in range(5)]
        titles = [f"{float(found['time'][i]):.2f} s" for i in chosen]
        save(voxel_figure([shells[i] for i in chosen], titles), plot)
    tell_saved(out, json_file, plot)


def recognize_pose(
    fit: Annotated[
        Path, typer.Argument(help="What `bayesmotion fit voxel-pose` saved."), SAVED_FIT
    ],
    hull: Annotated[Path, typer.Argument(help="Voxels, as `bayesmotion voxels` saved them.")],
    bvh: Annotated[Path | None, typer.Option(help="Write the poses as BVH."), BVH] = None,
    clip: Annotated[
        Path | None, typer.Option(help="The recording the voxels are of, to tell the error.")
    ] = None,
    most: Most = 100,
    out: Table = None,
    json_file: Json = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Recognise the pose in every frame of voxels.

    Without --clip tells how sure it is. In the BVH file the root is where the middle of the
    voxels is, and joints that are not recognised stand as they did on average in training.
    """
    import numpy as np

    from ..files import write_json
    from ..fit import load
    from ..models.voxel_pose.joint_angles import angles_of, rms_degrees
    from ..motion.io.bvh import write_bvh
    from ..motion.io.reading import write
    from ..motion.io.recordings import read_clip, resampled
    from ..sensing.voxels.carving import load_voxels
    from ..tasks.recognize_pose import recognize_pose as recognize

    trained, seen = load(fit), load_voxels(hull)
    frames, rate = seen.sizes["frame"], float(seen.attrs["frame_rate"])
    found = recognize(trained, seen, draws=most)
    console.say(f"{frames} frames, standard deviation {np.degrees(found.sd).mean():.1f} degrees")
    if clip is not None:
        motion = resampled(read_clip(clip, frame_rate=frame_rate, skeleton=skeleton), rate)
        if motion.sizes["frame"] != frames:
            raise InputError(clip, f"it has not the voxels' {frames} frames", "Give their clip")
        error = rms_degrees(angles_of(motion, found.labels), found.angles)
        angles = len(found.labels)
        console.say(f"error {error:.2f} degrees (root mean square, mean over {angles} angles)")
    if json_file is not None:
        content = {
            "labels": found.labels, "angles": found.angles.tolist(), "sd": found.sd.tolist(),
        }  # fmt: skip
        write_json(json_file, content)
    if bvh is not None:
        root = voxel_middles(seen) / (found.skeleton.metres or 1.0)
        name = str(seen["clip"].values[0])
        write_bvh(found.motion(root, frame_rate=rate, clip=name), bvh)
    if out is not None:
        write(found, out)
    tell_saved(out, bvh, json_file)


def voxel_middles(seen):
    """Return the middle of each frame's voxels, in metres."""
    import json

    import numpy as np

    from ..sensing.voxels.carving import hulls

    (side,) = json.loads(seen.attrs["side"]).values()
    return np.array([(hull.voxels.mean(axis=0) + 0.5) * side for hull in hulls(seen)])
