"""How poses become features of unit standard deviation, learned from training clips.

The encoding is learned once (layout of the features, mean and standard deviation of each,
angles of the joints left out) and then used on every clip, so that training and new clips
meet the program in the same units.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from ...errors import InputError
from ...motion.dataset import clips, require_angles, skeleton_of, skeletons
from ...motion.euler import in_order
from ...motion.features import Layout, decode, encode, heading_of, layout_of
from ...motion.joining import split
from ...motion.size import Lengths, body_size
from ...motion.skeleton import Skeleton

# Radians: the standard deviation of an angle that does not move, but for the digits of a file.
STILL = 1e-4
Rest = tuple[tuple[str, ...], Float[np.ndarray, " _"]]


@dataclass(frozen=True)
class PoseEncoding:
    """How poses become features of unit sd, learned from training clips.

    layout
        Layout of the features.
    mean, sd
        (D,) mean and standard deviation, of angles at least `STILL`.
    still
        (D,) which features never change in training. They tell nothing of styles and content;
        as columns of zeros they would call for a process without any variance.
    rest
        Mean angles of every joint, for those left out of the features, with the channels that
        they are of.
    frame_rate
        Frames a second; other clips must have the same.
    align_heading
        Whether each clip's heading is taken out.
    lengths
        What the root's velocity is told in: leg lengths of the clip's own body, or the unit of
        its file.
    """

    layout: Layout
    mean: Float[np.ndarray, " d"]
    sd: Float[np.ndarray, " d"]
    still: Bool[np.ndarray, " d"]
    rest: dict[str, Rest]
    frame_rate: float
    align_heading: bool
    lengths: Lengths = "body"

    @property
    def n_angles(self) -> int:
        """Number of angular features; they come first."""
        return self.layout.n_angles

    def heading(self, motion: xr.Dataset) -> float:
        """Heading that is taken out of a clip, zero where headings are kept."""
        return heading_of(motion) if self.align_heading else 0.0

    def size(self, skeleton: Skeleton) -> float:
        """Return the length of one in the features of a skeleton, in its unit."""
        return _size(skeleton, self.lengths)

    def in_units_of(self, skeleton: Skeleton) -> Float[np.ndarray, " d"]:
        """Return what brings features to the units of a skeleton: its size, of travel."""
        scale = np.ones(len(self.mean))
        scale[-3:] = self.size(skeleton)
        return scale

    def features(self, motion: xr.Dataset, heading: float) -> Float[np.ndarray, "n d"]:
        """Features of one clip in their own units.

        Raises
        ------
        InputError
            If the frame rate is not the training clips'.
        """
        if motion.attrs["frame_rate"] != self.frame_rate:
            raise InputError(
                f"clip {clips(motion)[0]!r}",
                f"it has {motion.attrs['frame_rate']:g} frames a second, "
                f"the training clips have {self.frame_rate:g}",
                "Bring it to that rate with resample()",
            )
        near, size = self.mean[: self.n_angles], self.size(skeleton_of(motion))
        return encode(motion, self.layout, heading, near, size)

    def scaled(self, features: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Centre and scale features."""
        return (features - self.mean) / self.sd

    def entries(self, features: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Centre and scale features, NaN for those that never change in training."""
        return np.where(self.still, np.nan, self.scaled(features))

    def unscaled(self, y: Float[np.ndarray, "*s n d"]) -> Float[np.ndarray, "*s n d"]:
        """Undo `scaled`."""
        return np.asarray(y) * self.sd + self.mean

    def motion(
        self,
        y: Float[np.ndarray, "n d"],
        skeleton: Skeleton,
        *,
        clip: str,
        start: Float[np.ndarray, " 3"],
        heading: float = 0.0,
        labels: dict[str, str] | None = None,
        source: str = "",
        allow_missing: bool = False,
    ) -> xr.Dataset:
        """Make a Motion of scaled features, on any skeleton with the layout's joints.

        Features that never change in training, and are NaN (`entries`), are at rest.
        """
        y = np.where(self.still & np.isnan(y), 0.0, y)
        return decode(
            self.unscaled(y),
            self.layout,
            skeleton,
            frame_rate=self.frame_rate,
            clip=clip,
            start=start,
            rest=self._rest_of(skeleton),
            heading=heading,
            size=self.size(skeleton),
            labels=labels,
            source=source,
            allow_missing=allow_missing,
        )

    def _rest_of(self, skeleton: Skeleton) -> dict[str, float]:
        """Return the angles of `rest` in the order of a skeleton's rotations."""
        out: dict[str, float] = {}
        for joint in skeleton:
            if joint.name in self.rest:
                channels, mean = self.rest[joint.name]
                values = _turned_alike(mean[None], channels, joint.channels)[0]
                labels = [f"{joint.name}/{channel}" for channel in joint.channels]
                out |= dict(zip(labels, values.tolist(), strict=True))
        return out


def learn_encoding(
    motion: xr.Dataset, *, align_heading: bool = False, lengths: Lengths = "body"
) -> PoseEncoding:
    """Learn the encoding from training clips.

    Features are centred: exporters differ in what pose has angles of zero, and a mean pose
    far from zero would have to be explained by what does not repeat with the content.

    Raises
    ------
    InputError
        If the skeletons do not share one layout, only markers are known, or nothing moves.
    """
    require_angles(motion)
    bodies = skeletons(motion)
    layouts = {name: layout_of(skeleton) for name, skeleton in bodies.items()}
    first, layout = next(iter(layouts.items()))
    for name, other in layouts.items():
        if not layout.same_features(other):
            told = _difference((bodies[first], bodies[name]), (layout, other))
            raise InputError(f"skeletons {first!r} and {name!r}", *told)
    y = np.concatenate(_alike(split(motion), layout, align_heading, lengths))
    mean = np.nanmean(y, axis=0)
    sd = np.nanstd(y, axis=0)
    still = sd <= 1e-12 * np.maximum(np.abs(mean), 1.0)
    if still.all():
        where = f"clips {', '.join(clips(motion))}"
        raise InputError(where, "nothing moves in them", "Give recordings of motion")
    angles = layout.n_angles
    still[: 2 * angles] |= np.tile(sd[:angles] < STILL, 2)
    rest = _mean_angles(split(motion))
    return PoseEncoding(
        layout,
        mean,
        np.where(still, np.maximum(sd, STILL), sd),
        still,
        rest,
        motion.attrs["frame_rate"],
        align_heading,
        lengths,
    )


def _mean_angles(parts: Mapping[str, xr.Dataset]) -> dict[str, Rest]:
    """Return the mean angles of joints, in the order that the first clip turns them in."""
    orders: dict[str, tuple[str, ...]] = {}
    every: dict[str, list[np.ndarray]] = {}
    for part in parts.values():
        for joint in skeleton_of(part):
            channels = joint.channels
            labels = [f"{joint.name}/{channel}" for channel in channels]
            order = orders.setdefault(joint.name, channels)
            angles = part["angle"].sel(dof=labels).values
            every.setdefault(joint.name, []).append(_turned_alike(angles, channels, order))
    return {
        name: (orders[name], _mean_of_seen(np.concatenate(each))) for name, each in every.items()
    }


def _turned_alike(
    values: Float[np.ndarray, "n c"], channels: tuple[str, ...], wanted: tuple[str, ...]
) -> Float[np.ndarray, "n w"]:
    """Return angles in the order of other channels; about fewer axes, as they are or zero."""
    if channels == wanted:
        return values
    if len(channels) == len(wanted) == 3:
        return in_order(values, channels, wanted)
    known = dict(zip(channels, values.T, strict=True))
    none = np.zeros(len(values))
    return (
        np.stack([known.get(channel, none) for channel in wanted], axis=1)
        if wanted
        else (values[:, :0])
    )


def _mean_of_seen(values: Float[np.ndarray, "n c"]) -> Float[np.ndarray, " c"]:
    there = np.isfinite(values)
    return np.where(there, values, 0.0).sum(axis=0) / np.where(
        there.any(axis=0), there.sum(axis=0), np.nan
    )


def _size(skeleton: Skeleton, lengths: Lengths) -> float:
    return body_size(skeleton) if lengths == "body" else 1.0


def _difference(
    bodies: tuple[Skeleton, Skeleton], layouts: tuple[Layout, Layout]
) -> tuple[str, str]:
    """Say how two skeletons with different layouts differ, and what to do about it."""
    for here, there in (bodies, bodies[::-1]):
        if lone := [name for name in here.names if name not in there.names]:
            return (
                f"{here.name!r} alone has the joints {', '.join(lone)}",
                "Train on clips whose skeletons have the same joints",
            )
    first, second = ({*one.maps, *one.angles} for one in layouts)
    joints = sorted({name.split("/")[0] for name in first ^ second})
    return (
        f"they have the same joints, but {', '.join(joints)} turn about different axes, as in "
        "AMC and BVH files of one person",
        "Train on files of one kind; bm.write makes BVH files of what was read from others",
    )


def _alike(
    parts: Mapping[str, xr.Dataset], layout: Layout, align_heading: bool, lengths: Lengths
) -> list[Float[np.ndarray, "n d"]]:
    """Features of clips, their exponential maps near those of the first clip."""
    out: list[np.ndarray] = []
    for part in parts.values():
        near = out[0][len(out[0]) // 2, : layout.n_angles] if out else None
        heading = heading_of(part) if align_heading else 0.0
        size = _size(skeleton_of(part), lengths)
        out.append(encode(part, layout, heading, near, size))
    return out
