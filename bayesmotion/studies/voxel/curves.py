"""The curves of Figure 4: radius of the support, number of radial bins, components.

Errors on half of the training frames, every other stretch of some frames, of a regression
trained on the other half, so that no test clip has a say. Beside the paper's three
settings there are the number of latent dimensions of the mixture's components and the least
noise, about which the paper says nothing, and the share of the poses' variance regressed.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...models.voxel_pose import VoxelPose
from ...models.voxel_pose.features import Descriptors, describe
from ...models.voxel_pose.joint_angles import rms_degrees
from ...models.voxel_pose.mixture_ppca.em import fit_mixture
from ...sensing.voxels.carving import Hull
from ...sensing.voxels.shape_context import ShapeContext
from ..stages import Stages
from .data import Seen
from .models import Regressor, features_of

# Frames of either half and of a stretch, descriptors and components while the others are varied.
FRAMES = 350
STRETCH = 8
POINTS = 20_000
COMPONENTS = 80
STEPS = 6
# The kernel's length, in medians of distances: the same for all, so that they are comparable.
LENGTH = 0.7
GRID = {
    "radius": (0.15, 0.25, 1.0 / 3.0, 0.45),
    "radial_bins": (2, 3, 4, 6),
    "components": (20, 40, 80, 160),
    "latent": (1, 3, 5, 10),
    "share": (0.8, 0.9, 0.95, 0.98),
    "least_noise": (0.02, 0.1, 0.2, 0.4),
}

Half = list[tuple[Seen, np.ndarray]]


def curves_plan() -> dict[str, Any]:
    """The settings of this part of the study."""
    return {
        "frames": FRAMES,
        "stretch": STRETCH,
        "points": POINTS,
        "components": COMPONENTS,
        "steps": STEPS,
        "length_scale": LENGTH,
        "grid": {name: list(values) for name, values in GRID.items()},
    }


def curves(
    training: dict[str, Seen], model: VoxelPose, stages: Stages, seed: int
) -> dict[str, dict[str, float]]:
    """Return for every setting the error in degrees at each of its values, a stage each."""
    small = replace(model, components=COMPONENTS, mixture_points=POINTS, length=LENGTH)
    halves = [_half(list(training.values()), which) for which in (0, 1)]
    tried: dict[VoxelPose, float] = {}
    features_of = _Features(halves, seed)

    def error_at(changed: VoxelPose) -> float:
        if changed not in tried:
            tried[changed] = _error(features_of(changed), halves, changed)
        return tried[changed]

    return {
        name: {
            f"{value:.3g}": stages.do(
                "curves", name, f"{value:.3g}",
                work=partial(error_at, _changed(small, name, value)),
            )
            for value in values
        }
        for name, values in GRID.items()
    }  # fmt: skip


def _changed(model: VoxelPose, name: str, value: float) -> VoxelPose:
    if name == "radius":
        return replace(model, context=replace(model.context, reach=value))
    if name == "radial_bins":
        return replace(model, context=replace(model.context, radial=int(value)))
    if name in ("share", "least_noise"):
        return replace(model, **{name: value})
    return replace(model, **{name: int(value)})


def _half(seen: list[Seen], which: int) -> Half:
    """Take every other stretch of every clip, and of their frames evenly some.

    Whole clips held out would hold out whole kinds of motion: of each take that trains
    there is only one.
    """
    chosen = []
    for one in seen:
        rows = np.arange(len(one.clip))
        first = np.array([np.flatnonzero(one.clip == clip)[0] for clip in one.clip])
        chosen.append((one, rows[(rows - first) // STRETCH % 2 == which]))
    total = sum(len(rows) for _, rows in chosen)
    every = max(1, round(total / FRAMES))
    return [(one, rows[::every]) for one, rows in chosen]


class _Features:
    """Features of both halves; those of the settings asked for last are not computed again."""

    def __init__(self, halves: list[Half], seed: int) -> None:
        self.halves, self.seed = halves, seed
        self.described: dict[ShapeContext, list[Descriptors]] = {}
        self.found: dict[tuple, list[np.ndarray]] = {}

    def __call__(self, model: VoxelPose) -> list[np.ndarray]:
        key = (model.context, model.components, model.latent)
        if key not in self.found:
            if model.context not in self.described:
                one = [describe(_hulls(half), model.context, model.cell) for half in self.halves]
                self.described = {model.context: one}
            described = self.described[model.context]
            points = described[0].sample(model.mixture_points, self.seed)
            mixture = fit_mixture(
                points, model.components, model.latent, seed=self.seed, max_steps=STEPS
            ).mixture
            self.found = {key: [features_of(one, mixture) for one in described]}
        return self.found[key]


def _error(x: list[np.ndarray], halves: list[Half], model: VoxelPose) -> float:
    fitted, held = (np.concatenate([one.angles[rows] for one, rows in half]) for half in halves)
    regressor = Regressor.of(x[0], fitted, halves[0][0][0].labels, model)
    return rms_degrees(held, regressor(x[1])[0])


def _hulls(half: Half) -> list[Hull]:
    hulls = []
    for one, rows in half:
        wanted = set(rows.tolist())
        hulls += [hull for index, hull in enumerate(one.hulls()) if index in wanted]
    return hulls
