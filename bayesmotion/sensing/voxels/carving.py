"""From a motion to voxels, frame by frame, and voxels as a data set.

The data set `carve` gives has

    voxel        (count, space) whole numbers: the voxels of all frames one after the other
    surface      (count) whether it has an empty neighbour
    voxels       (frame) how many voxels each frame has
    clip, time   (frame) as in the motion

and the attributes ``side`` and ``height`` in metres, as JSON by clip.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Bool, Int

from ...errors import InputError
from ...files import VOXELS
from ...motion import skeleton_of
from ...motion.dataset import clips
from ...netcdf import read_netcdf, write_netcdf
from .body import Ellipsoids, body_of, pose_body
from .cameras import Camera, moved
from .hull import MEASURE, PER_HEIGHT, Region, height_of, region_of, surface, visual_hull
from .silhouettes import Noise, silhouettes, spoil


@dataclass(frozen=True)
class Stage:
    """Where a clip is seen: its body in every frame, and the cameras around it.

    ellipsoids
        The body, in metres.
    cameras
        Standing around it.
    noise
        Of the silhouettes; None for perfect ones.
    """

    ellipsoids: Ellipsoids
    cameras: Sequence[Camera]
    noise: Noise | None = None

    def pictures(
        self, frame: int, random: np.random.Generator
    ) -> list[Bool[np.ndarray, "height width"]]:
        """Draw the silhouettes of a frame; `random` makes their noise."""
        drawn = silhouettes(self.ellipsoids, frame, self.cameras)
        if self.noise is None:
            return drawn
        return [spoil(picture, self.noise, random) for picture in drawn]


def stage(
    motion: xr.Dataset,
    cameras: Sequence[Camera],
    *,
    noise: Noise | None = None,
    follow: bool = True,
) -> Stage:
    """Put the body of one clip between cameras.

    Parameters
    ----------
    motion
        Motion of one clip.
    cameras
        Where they stand; the floor is at height 0.
    noise
        Of the silhouettes.
    follow
        Whether the cameras are set up around the middle of the clip's path, and the
        floor under its lowest point, or stand in the motion's own world.
    """
    ellipsoids = pose_body(body_of(skeleton_of(motion)), motion)
    if follow:
        around = ellipsoids.centre.reshape(-1, 3)
        middle = (around.max(axis=0) + around.min(axis=0)) / 2
        middle[1] = around[:, 1].min()
        cameras = moved(cameras, middle)
    return Stage(ellipsoids, list(cameras), noise)


@dataclass(frozen=True)
class Hull:
    """Voxels of one frame: (n, 3) whole numbers, and which of them are at the surface."""

    voxels: Int[np.ndarray, "n 3"]
    surface: Bool[np.ndarray, " n"]

    @property
    def shell(self) -> Int[np.ndarray, "s 3"]:
        """The surface voxels."""
        return self.voxels[self.surface]


@dataclass(frozen=True)
class Carver:
    """Makes silhouettes into voxels; the first frame gives the subject's height.

    height
        In metres.
    side
        Of a voxel, in metres: a sixtieth of the height.
    """

    cameras: Sequence[Camera]
    region: Region
    height: float
    side: float

    @classmethod
    def of_first(
        cls,
        pictures: Sequence[Bool[np.ndarray, "height width"]],
        cameras: Sequence[Camera],
        measure: float = MEASURE,
    ) -> "Carver":
        """Measure the subject in the silhouettes of the first frame."""
        region = region_of(cameras)
        height = height_of(pictures, cameras, region, measure)
        return cls(cameras, region, height, height / PER_HEIGHT)

    def __call__(self, pictures: Sequence[Bool[np.ndarray, "height width"]]) -> Hull:
        """Carve the voxels of a frame."""
        voxels = visual_hull(pictures, self.cameras, self.side, self.region)
        return Hull(voxels, surface(voxels))


def carve(
    motion: xr.Dataset,
    cameras: Sequence[Camera],
    *,
    seed: int,
    noise: Noise | None = None,
    follow: bool = True,
    progress: Callable[[int], None] | None = None,
) -> xr.Dataset:
    """Carve voxels in every frame of one clip from its silhouettes.

    Parameters
    ----------
    motion
        Motion of one clip.
    cameras, noise, follow
        As for `stage`.
    seed
        Of the noise.
    progress
        Called with the frames done.

    Raises
    ------
    InputError
        If the clip or the cameras cannot be used, or a frame shows no voxel.
    """
    (clip,) = clips(motion)
    seen = stage(motion, cameras, noise=noise, follow=follow)
    random = np.random.default_rng(seed)
    found: list[Hull] = []
    carver = None
    for frame in range(motion.sizes["frame"]):
        pictures = seen.pictures(frame, random)
        carver = carver or Carver.of_first(pictures, seen.cameras)
        hull = carver(pictures)
        if len(hull.voxels) == 0:
            raise InputError(
                f"clip {clip!r}, frame {frame}", "no voxel is seen", "Check the cameras"
            )
        found.append(hull)
        if progress is not None:
            progress(frame + 1)
    assert carver is not None  # a Motion has frames
    return _as_dataset(found, motion, carver)


def _as_dataset(found: Sequence[Hull], motion: xr.Dataset, carver: Carver) -> xr.Dataset:
    (clip,) = clips(motion)
    return xr.Dataset(
        {
            "voxel": (("count", "space"), np.concatenate([h.voxels for h in found])),
            "surface": ("count", np.concatenate([h.surface for h in found])),
            "voxels": ("frame", np.array([len(h.voxels) for h in found])),
        },
        {name: motion[name] for name in ("frame", "clip", "time")}
        | {"space": motion["space"].values},
        {
            "side": json.dumps({clip: carver.side}),
            "height": json.dumps({clip: carver.height}),
            "cameras": len(carver.cameras),
            "frame_rate": motion.attrs["frame_rate"],
        },
    )


def hulls(voxels: xr.Dataset) -> Iterator[Hull]:
    """Give the frames of a data set that `carve` made, one after the other."""
    ends = np.cumsum(voxels["voxels"].values)
    places, shells = voxels["voxel"].values, voxels["surface"].values
    for first, last in zip(np.concatenate([[0], ends[:-1]]), ends, strict=True):
        yield Hull(places[first:last], shells[first:last])


def save_voxels(voxels: xr.Dataset, path: str | Path) -> None:
    """Write voxels as netCDF; an older file stays until the new one is whole."""
    VOXELS.check(path)
    small = voxels.assign(voxel=voxels["voxel"].astype(np.int16))
    write_netcdf(path, small)


def load_voxels(path: str | Path) -> xr.Dataset:
    """Read voxels that `save_voxels` wrote.

    Raises
    ------
    InputError
        If the file is not there or holds no voxels.
    """
    voxels = read_netcdf(path, "Make voxels with `bayesmotion voxels`").to_dataset()
    if "voxel" not in voxels or "surface" not in voxels or "side" not in voxels.attrs:
        raise InputError(path, "it holds no voxels", "Make voxels with `bayesmotion voxels`")
    return voxels.assign(voxel=voxels["voxel"].astype(np.int64))
