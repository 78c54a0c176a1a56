"""Pictures of the gait-pose study: surfaces, confidence, stick figures, synthesised walks."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...fit import Fit
from ...models.gait_pose.data import GaitData
from ...motion.io.bvh import write_bvh
from ...plots import compare, confidence, save, surfaces
from ...tasks.gait import Trained, along, hidden, interpolate, limb_columns, paths, reconstruct
from .contest import Contest

GRID = 60
SHOWN = {"0.5": 0, "1.25": 0, "stride": 1}  # Figures 10 and 11: scale and which cycle
FIGURES = 6


def draw_gait_pictures(contest: Contest, fits: Mapping[str, Fit], out: Path) -> None:
    """Draw Figures 2, 8, 10, 11 and 14, and write the synthesised walks as BVH."""
    for name in ("torus3", "cylinder3", "torus1"):
        training = fits[name].training
        assert isinstance(training, GaitData), "the study fits GaitPose"
        both = {"ideal": training.ideal(), "learned": np.asarray(fits[name].values()["x"])}
        layers = [f"scale {scale:g}" for scale in training.scales]
        save(surfaces(both, training.index(), layers), out / f"surface_{name}.png")
    save(_confidence(contest.trained), out / "figure8_confidence.png")
    encoding = contest.walks.encoding
    for scale, which in SHOWN.items():
        cycle = contest.walks.test[scale][which]
        rows = {"true": encoding.motion(cycle, "true")}
        for name, trained in contest.trained.items():
            rows[name] = encoding.motion(interpolate(trained, cycle).means(), name)
        save(compare(rows, count=FIGURES), out / f"interpolation_{scale}.png")
        torus = contest.trained["torus3"]
        columns = limb_columns(torus, ["larm", "lleg"])
        made = reconstruct(torus, hidden(cycle, columns)).means()
        rows = {"true": rows["true"], "left side made": encoding.motion(made, "left side made")}
        save(compare(rows, count=FIGURES), out / f"reconstruction_{scale}.png")
    for name in ("torus3", "torus1"):
        rows = {}
        for path, places in paths(contest.trained[name]).items():
            made = along(contest.trained[name], **places)
            rows[path] = encoding.motion(made.means(), path)
            write_bvh(rows[path], out / f"{name} {path}.bvh".replace(" ", "_"))
        save(compare(rows, count=FIGURES), out / f"figure14_{name}.png")


def _confidence(trained: Mapping[str, Trained]):
    """Log precision of a feature on the plane where the second axis has its median."""
    maps, points, extents = {}, {}, {}
    for name in ("ll_gpdm", "torus1", "torus3"):
        # These are point estimates: one draw.
        process = trained[name].draws[0].process
        x = np.asarray(process.x)
        cut = float(np.median(x[:, 1]))
        low, high = x[:, [0, 2]].min(axis=0) - 0.5, x[:, [0, 2]].max(axis=0) + 0.5
        across, up = (np.linspace(low[i], high[i], GRID) for i in (0, 1))
        grid = np.stack([a.ravel() for a in np.meshgrid(across, [cut], up, indexing="ij")], axis=1)
        variance = np.asarray(process.at(grid)[1][:, 0])
        total = variance + float(process.noise)
        maps[name] = -np.log(total).reshape(GRID, GRID).T
        points[name] = x[np.abs(x[:, 1] - cut) < 0.25][:, [0, 2]]
        extents[name] = (low[0], high[0], low[1], high[1])
    return confidence(maps, points, extents)
