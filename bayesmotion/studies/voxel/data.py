"""What the voxel study looks at: clips, cameras, and what they see of the clips.

Clips were chosen by what their subjects do, before any of them was tried. Subject 16 walked,
turned, jogged and jumped twice over; subject 05 danced. Of each pair of takes one trains
and one tests; jogs being short, all other clips of them train, too. Of the clips of slow or
long motions fewer frames are taken, so that no motion outweighs the others.
"""

import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from ...files import replacing
from ...models.voxel_pose.joint_angles import angle_labels, angles_of, mirrored
from ...motion import check, drop, skeleton_of
from ...motion.datasets.public import cmu
from ...sensing.voxels.cameras import FIELD, Camera, circle
from ...sensing.voxels.carving import Carver, Hull, stage
from ...sensing.voxels.silhouettes import Noise
from ..stages import Say


@dataclass(frozen=True)
class Clips:
    """Clips of one motion; of each every so many-th frame is taken."""

    train: tuple[str, ...]
    test: tuple[str, ...]
    every: int


MOTIONS = {
    "walk": Clips(
        ("16_15", "16_21", "16_31", "16_47"), ("16_16", "16_22", "16_32", "16_58"), every=6
    ),
    "turn": Clips(
        ("16_11", "16_13", "16_17", "16_19", "16_23", "16_25", "16_27", "16_29"),
        ("16_12", "16_14", "16_18", "16_20", "16_24", "16_26", "16_28", "16_30"),
        every=5,
    ),
    "jog": Clips(
        (
            *("16_35", "16_37", "16_39", "16_41", "16_43", "16_48", "16_49"),
            *("16_50", "16_51", "16_52", "16_53", "16_54", "16_55", "16_56"),
        ),
        ("16_36", "16_38", "16_40", "16_42", "16_44"),
        every=4,
    ),
    "jump": Clips(
        ("16_01", "16_03", "16_05", "16_07", "16_09"),
        ("16_02", "16_04", "16_06", "16_08", "16_10"),
        every=6,
    ),
    "dance": Clips(
        ("05_09", "05_14", "05_16", "05_18", "05_20"),
        ("05_10", "05_15", "05_17", "05_19"),
        every=12,
    ),
}
# Other people: clips of the same motions, of subjects nobody of whom trains.
OTHERS = {
    "walk": Clips((), ("07_01", "35_01", "08_01"), every=6),
    "turn": Clips((), ("09_12",), every=12),
    "jog": Clips((), ("09_01", "35_17", "02_03"), every=4),
    "jump": Clips((), ("02_04", "49_02"), every=12),
    "dance": Clips((), ("49_06", "49_08"), every=10),
}


@dataclass(frozen=True)
class Setup:
    """Cameras, what is wrong with their silhouettes, and how many of them carve a frame.

    count, radius, height, first, field
        Of the cameras, see `circle`.
    noise
        Of the silhouettes.
    carve
        How many cameras carve a frame, drawn anew for each; None for all.
    """

    count: int = 6
    radius: float = 6.0
    height: float = 1.6
    first: float = 0.0
    field: float = FIELD
    noise: Noise | None = None
    carve: int | None = None

    @property
    def cameras(self) -> list[Camera]:
        """The cameras, calibrated."""
        return circle(
            self.count, radius=self.radius, height=self.height, first=self.first, field=self.field
        )


# The six that train, and others; `noisy` are the six that train, `fewer` four of them.
SETUPS = {
    "six": Setup(),
    "four": Setup(4, first=20.0),
    "six_others": Setup(first=30.0),
    "nearer_higher": Setup(radius=4.5, height=2.6, first=15.0, field=40.0),
    "noisy": Setup(noise=Noise(flips=0.05, holes=2, radius=5.0, window=5)),
    "fewer": Setup(carve=4),
}
TESTED = ("six", "four", "six_others", "nearer_higher", "noisy")


@dataclass(frozen=True)
class Seen:
    """What cameras saw of some frames.

    clip, frame
        (F,) where each is from: name of the clip and number of its frame.
    angles
        (F, A) true angles in radians, by `labels`.
    voxels, counts
        Surface voxels (n, 3) of all frames one after the other, and how many each has.
    moments
        (F, 8 V) of the silhouettes, see `picture_moments`.
    seconds
        A frame, for silhouettes and for voxels.
    """

    clip: np.ndarray
    frame: np.ndarray
    labels: tuple[str, ...]
    angles: Float[np.ndarray, "f a"]
    voxels: Int[np.ndarray, "n 3"]
    counts: Int[np.ndarray, " f"]
    moments: Float[np.ndarray, "f m"]
    seconds: Float[np.ndarray, " two"]

    def hulls(self) -> Iterator[Hull]:
        """Return the surface voxels of every frame."""
        for count, end in zip(self.counts, np.cumsum(self.counts), strict=True):
            part = self.voxels[end - count : end].astype(np.int64)
            yield Hull(part, np.ones(len(part), dtype=bool))


def observe(clip: str, every: int, setup: str, data: Path | None, cache: Path, seed: int) -> Seen:
    """Let cameras see a clip, or read what they saw from the cache."""
    path = cache / setup / f"{clip}_{every}.npz"
    if not path.is_file():
        seen = _observe(clip, every, SETUPS[setup], data, seed)
        with replacing(path) as temporary:
            np.savez_compressed(temporary, **vars(seen))
    with np.load(path, allow_pickle=False) as stored:
        parts: dict[str, Any] = {name: stored[name] for name in stored.files}
    parts["labels"] = tuple(map(str, parts["labels"]))
    return Seen(**parts)


def observe_all(
    clips: Mapping[str, Clips],
    which: str,
    setup: str,
    data: Path | None,
    cache: Path,
    seed: int,
    say: Say,
) -> dict[str, Seen]:
    """Let cameras see all training or test clips of every motion."""
    found = {}
    for motion, chosen in clips.items():
        names = chosen.train if which == "train" else chosen.test
        found[motion] = together(
            [observe(clip, chosen.every, setup, data, cache, seed) for clip in names]
        )
        say(f"{setup}, {which}, {motion}: {len(found[motion].counts)} frames")
    return found


def thinned(clips: Mapping[str, Clips]) -> dict[str, Clips]:
    """Take every third of the frames."""
    return {name: replace(one, every=3 * one.every) for name, one in clips.items()}


@lru_cache(maxsize=64)
def recording(clip: str, data: Path | None) -> xr.Dataset:
    """Read a clip, once for all cameras, without the frames that cannot be right."""
    motion = cmu(clip, None if data is None else data / "cmu")
    return drop(motion, [finding for finding in check(motion) if finding.drop])


def reflected(seen: Seen) -> Seen:
    """Return what the cameras would have seen of frames in a mirror that swaps left and right.

    The cameras must be evenly on a circle with the first before the subject, as `six` are.
    """
    cameras = seen.moments.shape[1] // len(ODD)
    moments = seen.moments.reshape(len(seen.counts), cameras, len(ODD)) * ODD
    return replace(
        seen,
        angles=mirrored(seen.angles, seen.labels),
        voxels=seen.voxels * np.array([-1, 1, 1], dtype=seen.voxels.dtype),
        moments=moments[:, -np.arange(cameras) % cameras].reshape(seen.moments.shape),
    )


def together(parts: list[Seen]) -> Seen:
    """Put what was seen of several clips one after the other."""
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("clip", "frame", "angles", "voxels", "counts", "moments")
    }
    frames = np.array([len(part.counts) for part in parts], dtype=float)
    seconds = np.average([part.seconds for part in parts], axis=0, weights=frames)
    return Seen(**joined, labels=parts[0].labels, seconds=seconds)


# Moments that change their sign in a mirror, in the order of `picture_moments`.
ODD = np.array([1, -1, 1, -1, 1, -1, 1, 1])


def _observe(clip: str, every: int, setup: Setup, data: Path | None, seed: int) -> Seen:
    # The first frame of the recording gives the subject's height.
    motion = recording(clip, data).isel(frame=slice(None, None, every))
    labels = angle_labels(skeleton_of(motion))
    place = stage(motion, setup.cameras, noise=setup.noise)
    random = np.random.default_rng([seed, zlib.crc32(clip.encode())])
    shells, moments = [], []
    carver, seconds = None, np.zeros(2)
    for frame in range(motion.sizes["frame"]):
        times = [time.perf_counter()]
        pictures = place.pictures(frame, random)
        times.append(time.perf_counter())
        if carver is None:
            carver = Carver.of_first(pictures, place.cameras)
            times[1] = time.perf_counter()
        shells.append(_carved(carver, pictures, setup.carve, random).shell)
        times.append(time.perf_counter())
        seconds += np.diff(times)
        moments.append(np.concatenate([picture_moments(picture) for picture in pictures]))
    return Seen(
        np.full(len(shells), clip),
        np.arange(len(shells)) * every,
        labels,
        angles_of(motion, labels),
        np.concatenate(shells).astype(np.int16),
        np.array([len(shell) for shell in shells]),
        np.array(moments),
        seconds / len(shells),
    )


def _carved(
    carver: Carver, pictures: Sequence[np.ndarray], count: int | None, random: np.random.Generator
) -> Hull:
    """Carve with all cameras, or with so many drawn ones."""
    if count is None:
        return carver(pictures)
    chosen = np.sort(random.choice(len(pictures), count, replace=False))
    part = replace(carver, cameras=[carver.cameras[i] for i in chosen])
    return part([pictures[i] for i in chosen])


def picture_moments(picture: Bool[np.ndarray, "height width"]) -> Float[np.ndarray, " eight"]:
    """Return the central moments of orders 2 and 3 of a silhouette, and how wide it is.

    Scaled by its area, so that its size does not matter; the width is in heights.
    """
    high, wide = np.flatnonzero(picture.any(axis=1)), np.flatnonzero(picture.any(axis=0))
    if len(high) == 0:
        return np.zeros(8)
    rows, columns = np.nonzero(picture[high[0] : high[-1] + 1, wide[0] : wide[-1] + 1])
    u, v = columns - columns.mean(), rows - rows.mean()
    area = float(len(rows))
    powers = ((2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
    up, vp = [np.ones_like(u), u, u * u, u * u * u], [np.ones_like(v), v, v * v, v * v * v]
    moments = [up[p] @ vp[q] / area ** (1 + (p + q) / 2) for p, q in powers]
    return np.array([*moments, (wide[-1] - wide[0] + 1) / (high[-1] - high[0] + 1)])
