"""The last frames of a clip that goes on, as features: the same numbers as of a clip of these."""

from dataclasses import dataclass, field

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...errors import InputError
from ...motion.dataset import skeleton_of
from ...motion.features import continuous, heading_along
from ...motion.size import body_size
from ...motion.skeleton import Skeleton
from .encoding import PoseEncoding

Columns = tuple[str, np.ndarray, np.ndarray]


class _Body:
    """Where the features of a skeleton come from, in the columns of angles that files have."""

    def __init__(self, frame: xr.Dataset, encoding: PoseEncoding) -> None:
        self.skeleton = skeleton_of(frame)
        self.dofs = frame["dof"].values
        layout, where = encoding.layout, {str(dof): at for at, dof in enumerate(self.dofs)}
        lacking = sorted({*layout.maps} - {*self.skeleton.names})
        lacking += [dof for dof in layout.angles if dof not in where]
        if lacking:
            raise InputError(
                f"skeleton {self.skeleton.name!r}",
                f"it has no {', '.join(lacking)}",
                "Use clips whose skeletons name their joints as those of training do",
            )
        self.size, self.legs = encoding.size(self.skeleton), body_size(self.skeleton)
        orders: dict[str, list[tuple[int, list[int]]]] = {}
        for index, name in enumerate(layout.maps):
            channels = self.skeleton.joints[self.skeleton.index(name)].channels
            columns = [where[f"{name}/{channel}"] for channel in channels]
            if index == 0:
                self.channels, self.root = channels, columns
            else:
                orders.setdefault(_order(channels), []).append((index, columns))
        self.maps: list[Columns] = [
            (order, np.array([index for index, _ in some]), np.array([own for _, own in some]))
            for order, some in orders.items()
        ]
        self.angles = [where[dof] for dof in layout.angles]


@dataclass
class RecentPoses:
    """The last frames of a clip, at most `size`; `add` puts one more behind them.

    encoding
        Of the training clips.
    size
        So many frames are kept, and the one before them for its velocity.
    """

    encoding: PoseEncoding
    size: int
    _body: _Body | None = None
    # Of every frame: angular features but those of the root, angles of the root, and its place.
    _poses: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)
    _near: np.ndarray | None = None
    # The root's map in the frame before the window, as it was when it went.
    _left: np.ndarray | None = None
    heading: float = 0.0

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton of the frames."""
        assert self._body is not None, "no frame has come"
        return self._body.skeleton

    def add(self, frame: xr.Dataset) -> None:
        """Put a frame behind the others; it is a Motion of one frame, NaN where missing.

        Raises
        ------
        InputError
            If it is at another rate, or its skeleton is not that of training.
        """
        encoding = self.encoding
        if self._body is None:
            self._require_rate(frame)
            self._body = _Body(frame, encoding)
        body, angle = self._body, frame["angle"].values
        if angle.shape != (1, len(body.dofs)):
            raise InputError(
                "frame", f"its angles are {' x '.join(map(str, angle.shape))}, "
                f"of one frame there are 1 x {len(body.dofs)}",
                "Give the frames of one clip, one after the other",
            )  # fmt: skip
        pose, maps = np.full(encoding.n_angles, np.nan), len(encoding.layout.maps)
        turned = pose[: 3 * maps].reshape(maps, 3)
        for order, index, columns in body.maps:
            euler = angle[0][columns]
            there = np.isfinite(euler).all(axis=1)
            turned[index[there]] = Rotation.from_euler(order, euler[there]).as_rotvec()
        pose[3 * maps :] = angle[0][body.angles]
        near = encoding.mean[: 3 * maps].reshape(maps, 3) if self._near is None else self._near
        for joint in range(1, maps):
            turned[joint] = continuous(turned[joint][None], near[joint])[0]
        self._near = np.where(np.isfinite(turned), turned, near)
        self._poses.append((pose, angle[0][body.root], frame["root_position"].values[0]))
        if len(self._poses) > self.size + 1:
            del self._poses[0]

    def features(self) -> Float[np.ndarray, "n d"]:
        """Return scaled features of the last frames, at most `size`; NaN where missing.

        The heading is that of these frames. Of a first frame alone no velocity is known.
        """
        body, encoding = self._body, self.encoding
        assert body is not None, "no frame has come"
        pose, root, path = (np.stack(part) for part in zip(*self._poses, strict=True))
        before = len(pose) - self.size > 0
        if encoding.align_heading:
            kept = slice(1 if before else 0, None)
            self.heading = heading_along(path[kept], root[kept], body.channels, body.legs)
        turn_back = Rotation.from_rotvec([0.0, -self.heading, 0.0])
        seen = np.isfinite(root).all(axis=1)
        maps = np.full((len(root), 3), np.nan)
        turned = turn_back * Rotation.from_euler(_order(body.channels), root[seen])
        maps[seen] = turned.as_rotvec()
        near = encoding.mean[:3] if self._left is None else self._left
        pose[:, :3] = continuous(maps, near)
        if before and np.isfinite(pose[1, :3]).all():
            self._left = pose[1, :3].copy()
        path = turn_back.apply(path) / body.size
        features = np.concatenate([pose, _velocity(pose), _velocity(path)], axis=1)
        return encoding.entries(features[1:] if before else features)

    def motion(self, y: Float[np.ndarray, "n d"], clip: str) -> xr.Dataset:
        """Return scaled features of the frames to come as a Motion, behind the last frame."""
        frames = np.concatenate([y[:1], y])
        start = self._poses[-1][2]
        start = np.where(np.isfinite(start), start, 0.0)
        made = self.encoding.motion(
            frames, self.skeleton, clip=clip, start=start, heading=self.heading,
            source="followed frame by frame",
        )  # fmt: skip
        made = made.isel(frame=slice(1, None))
        return made.assign_coords(frame=np.arange(made.sizes["frame"]))

    def _require_rate(self, frame: xr.Dataset) -> None:
        rate = frame.attrs["frame_rate"]
        if rate != self.encoding.frame_rate:
            raise InputError(
                "frame",
                f"it is of {rate:g} frames a second, the training clips have "
                f"{self.encoding.frame_rate:g}",
                "Give frames at that rate",
            )


def _order(channels: tuple[str, ...]) -> str:
    return "".join(channel[1].upper() for channel in channels)


def _velocity(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    if len(values) == 1:
        return np.full_like(values, np.nan)
    difference = np.diff(values, axis=0)
    return np.concatenate([difference[:1], difference])
