"""Voxels of a synthetic walk for `VoxelPose.example`."""

import numpy as np
import xarray as xr

from ...motion.synthetic.walkers import synthetic_walkers
from ...sensing.voxels.cameras import circle
from .data import voxel_recordings


def example(seed: int) -> xr.Dataset:
    """Return voxels of two seconds of a walk as four cameras see it, and the poses.

    The poses of two frames are missing.
    """
    walk = synthetic_walkers(["ann"], ["walk"], seconds=2.0, frame_rate=8.0, seed=seed)
    recordings = voxel_recordings(walk, circle(4), seed=seed)
    angle = recordings["angle"].copy()
    angle[[3, 10]] = np.nan
    return recordings.assign(angle=angle)
