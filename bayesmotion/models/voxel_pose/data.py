"""Voxels and poses as the model sees them.

Recordings are voxels as `sensing.voxels.carving.carve` gives them, with

    angle        (frame, dof) joint angles in radians, NaN where unknown

and the attributes ``skeleton``, as JSON, and ``rest``: the angles in radians of degrees of
freedom that are not recognised, as JSON. Of new recordings angle may be missing.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import Units
from ...motion import skeleton_of, split
from ...sensing.voxels.cameras import Camera
from ...sensing.voxels.carving import carve, hulls
from ...sensing.voxels.shape_context import ShapeContext
from .features import describe
from .joint_angles import angle_labels, angles_of
from .mixture_ppca.data import Points, points_of
from .pose_space import PoseSpace, learn_space
from .regression import candidates

# Of the choice of the descriptors that the mixture explains.
SAMPLED = 0


class Frames(NamedTuple):
    """Arrays of F frames.

    descriptors, frame
        (n, D) shape contexts of all frames, and (n,) the number of each one's frame.
    pose
        (F, P) principal components of the poses, of unit variance; NaN where one is unknown.
    points
        Those of the descriptors that the mixture explains; None of new recordings.
    centres
        (B,) numbers of the frames with basis functions; None of new recordings.
    """

    descriptors: Float[AnyArray, "n d"]
    frame: Int[AnyArray, " n"]
    pose: Float[AnyArray, "f p"]
    points: Points | None = None
    centres: Int[AnyArray, " b"] | None = None


@dataclass(frozen=True)
class PoseData:
    """Frames with what brings principal components back to angles.

    frames
        The arrays for the program.
    space
        Principal components of the training poses.
    sd
        (P,) of the components, in units of points on circles.
    names, clips
        (F,) of the frames: their numbers and clips.
    """

    frames: Frames
    space: PoseSpace
    names: tuple
    clips: np.ndarray

    @property
    def data(self) -> tuple[Frames]:
        """The arguments of the model's program."""
        return (self.frames,)

    @property
    def components(self) -> list[str]:
        """Names of the principal components."""
        return [f"component {i + 1}" for i in range(len(self.space.scale))]

    def observed(self) -> xr.Dataset:
        """Return what the model explains: ``pose`` (frame, output), in training ``descriptor``."""
        found = {"pose": (("frame", "output"), np.asarray(self.frames.pose))}
        if self.frames.points is not None:
            found["descriptor"] = (("point", "bin"), np.asarray(self.frames.points.t))
        return xr.Dataset(found, {"frame": list(self.names), "output": self.components})

    def constants(self) -> xr.Dataset:
        """Return what brings principal components back to angles, see `PoseSpace`."""
        space = self.space
        return xr.Dataset(
            {
                "mean": ("circle", space.mean),
                "components": (("output", "circle"), space.components),
                "scale": ("output", space.scale),
                "rest": (("angle", "row", "column"), space.rest),
            },
            {"angle": list(space.labels), "output": self.components},
        )

    def units(self) -> dict[str, Units]:
        """Return the units of ``pose``: unit variance; `PoseSpace` brings it to angles."""
        size = len(self.space.scale)
        one = {"pose": Units(np.zeros(size), np.ones(size))}
        if self.frames.points is None:
            return one
        bins = self.frames.points.t.shape[1]
        return one | {"descriptor": Units(np.zeros(bins), np.ones(bins))}


def prepare_frames(
    recordings: xr.Dataset,
    context: ShapeContext,
    cell: int,
    share: float,
    points: int,
    most: int,
    trained: PoseData | None,
) -> PoseData:
    """Describe voxels, and take poses to principal components; arguments as of `VoxelPose`.

    A pose with an angle missing is missing as a whole.

    Raises
    ------
    InputError
        If there are no voxels, a frame has none, or poses are lacking or of other angles.
    """
    if "voxel" not in recordings or "surface" not in recordings:
        raise InputError("recordings", "there are no voxels", "Make them with `sensing.carve`")
    whole = recordings.assign(voxel=recordings["voxel"].astype(np.int64))
    described = describe(hulls(whole), context, cell)
    names = tuple(recordings["frame"].values.tolist())
    clips = np.asarray(recordings["clip"].values)
    if trained is not None:
        pose = _poses(recordings, trained.space)
        frames = Frames(described.values, described.frame, pose)
        return PoseData(frames, trained.space, names, clips)
    if "angle" not in recordings:
        raise InputError("recordings", "there are no poses", "Give angle (frame, dof)")
    angles = np.asarray(recordings["angle"].values, dtype=float)
    known = ~np.isnan(angles).any(axis=1)
    if not known.any():
        raise InputError("recordings", "every pose lacks an angle", "Give whole poses")
    labels = tuple(map(str, recordings["angle"]["dof"].values))
    space = learn_space(angles[known], labels, share)
    frames = Frames(
        described.values,
        described.frame,
        space.encode(angles),
        points_of(described.sample(points, SAMPLED)),
        candidates(len(angles), most),
    )
    return PoseData(frames, space, names, clips)


def _poses(recordings: xr.Dataset, space: PoseSpace) -> Float[np.ndarray, "f p"]:
    """Return the principal components of new recordings' poses, NaN where there are none."""
    if "angle" not in recordings:
        return np.full((recordings.sizes["frame"], len(space.scale)), np.nan)
    labels = list(map(str, recordings["angle"]["dof"].values))
    if sorted(labels) != sorted(space.labels):
        raise InputError("recordings", "their angles are not those that trained", "Give the same")
    chosen = recordings["angle"].sel(dof=list(space.labels))
    return space.encode(np.asarray(chosen.values, dtype=float))


def voxel_recordings(
    motion: xr.Dataset,
    cameras: Sequence[Camera],
    *,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> xr.Dataset:
    """Return what cameras would see of motion capture: recordings of a `VoxelPose`.

    Parameters
    ----------
    motion
        Motion of any number of clips, whose skeletons name their joints alike.
    cameras
        Where they stand.
    seed
        Of noise in the silhouettes.
    progress
        Called with the frames done.

    Raises
    ------
    InputError
        If a clip or the cameras cannot be used.
    """
    parts = list(split(motion).values())
    skeleton = skeleton_of(parts[0])
    labels = angle_labels(skeleton)
    carved, done = [], 0
    for part in parts:
        one = carve(part, cameras, seed=seed)
        angle = xr.DataArray(angles_of(part, labels), dims=("frame", "dof"))
        small = one["voxel"].astype(np.int16)
        carved.append(one.assign(angle=angle, voxel=small).assign_coords(dof=list(labels)))
        done += part.sizes["frame"]
        if progress is not None:
            progress(done)
    rest = {dof: float(np.nanmean(motion["angle"].sel(dof=dof))) for dof in skeleton.dofs}
    return joined(carved, skeleton=skeleton.to_json(), rest=json.dumps(rest))


def joined(parts: Sequence[xr.Dataset], **attrs: str) -> xr.Dataset:
    """Put voxels of several clips one after the other; frames are numbered through."""
    along = {
        "voxel": ("count", "space"),
        "surface": ("count",),
        "voxels": ("frame",),
        "angle": ("frame", "dof"),
    }
    found = {
        name: (dims, np.concatenate([part[name].values for part in parts]))
        for name, dims in along.items()
        if all(name in part.data_vars for part in parts)
    }
    first = parts[0]
    coords = {
        name: ("frame", np.concatenate([part[name].values for part in parts]))
        for name in ("clip", "time")
    }
    coords |= {"frame": np.arange(len(coords["clip"][1])), "space": first["space"].values}
    if "angle" in found:
        coords["dof"] = first["angle"]["dof"].values
    merged = {name: json.dumps(_merged(parts, name)) for name in ("side", "height")}
    return xr.Dataset(found, coords, {**first.attrs, **merged, **attrs})


def _merged(parts: Sequence[xr.Dataset], name: str) -> Mapping[str, float]:
    return {clip: value for part in parts for clip, value in json.loads(part.attrs[name]).items()}
