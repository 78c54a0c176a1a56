"""Pictures of the voxel study: hulls, a descriptor, estimated against true poses."""

from pathlib import Path

import numpy as np

from ...models.voxel_pose.features import describe
from ...models.voxel_pose.joint_angles import posed
from ...motion import make_motion, skeleton_of
from ...plots import compare, save
from ...plots.voxels import angle_figure, descriptor_figure, voxel_figure
from ...sensing.voxels.hull import basis
from .data import Seen, recording
from .models import Recognizer

DRAWN = ("root/heading", "lhumerus/z", "lradius/z", "rfemur/x", "rtibia/x", "lowerneck/x")


def draw_figures(seen: dict[str, Seen], fit: Recognizer, data: Path | None, out: Path) -> None:
    """Draw hulls of all motions, a descriptor, and poses and angles of a test clip of each."""
    panels, titles = [], []
    for name, one in seen.items():
        shells = [hull.shell for hull in one.hulls()]
        panels.append(shells[len(shells) // 3])
        titles.append(name)
    save(voxel_figure(panels, titles), out / "hulls.png")
    shell = panels[1]
    save(voxel_figure([shell, basis(shell)], ["surface", "basis"], columns=2), out / "basis.png")
    context = fit.model.context
    one = context.describe(shell, basis(shell)[:1])[0]
    shape = (context.radial, context.elevation, context.azimuth)
    save(descriptor_figure(one.reshape(shape), "one shape context"), out / "descriptor.png")
    for name, one in seen.items():
        _draw_clip(name, one, fit, data, out)


def _draw_clip(name: str, seen: Seen, fit: Recognizer, data: Path | None, out: Path) -> None:
    """Draw the first test clip of a motion: angles, and poses on the true path of the root."""
    clip = str(seen.clip[0])
    rows = np.flatnonzero(seen.clip == clip)
    wanted = set(rows.tolist())
    hulls = [hull for index, hull in enumerate(seen.hulls()) if index in wanted]
    angles, sd = fit(describe(hulls, fit.model.context, fit.model.cell))
    columns = [seen.labels.index(label) for label in DRAWN]
    figure = angle_figure(seen.angles[rows][:, columns], angles[:, columns], sd[:, columns], DRAWN)
    save(figure, out / f"angles_{name}.png")
    motion = recording(clip, data).isel(frame=seen.frame[rows])
    skeleton, root = skeleton_of(motion), motion["root_position"].values
    rate = float(motion.attrs["frame_rate"]) / float(seen.frame[rows][1])
    true = make_motion(skeleton, motion["angle"].values, root, frame_rate=rate, clip="true")
    estimated = posed(
        angles, seen.labels, skeleton, root, frame_rate=rate, clip="estimated", rest=dict(fit.rest)
    )
    save(compare({"true": true, "estimated": estimated}), out / f"poses_{name}.png")
