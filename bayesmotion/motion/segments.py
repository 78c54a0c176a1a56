"""Motion segments of different lengths as vectors of one length.

A segment is a clip that shows one task once. To compare segments of different people
they are normalised, as Perera, Kudoh and Ikeuchi do before they fill their tensor:

time      S samples at equal steps from the first frame to the last, of time or, with
          `pace="path"`, of the way the channels have gone (segments that pause at
          different places are aligned by how much has been moved), then the first
          K coefficients of the orthonormal cosine transform, divided by sqrt(S):
              c_k = S^(-1/2) sum_s x(s) b_k(s),   b_0 = S^(-1/2),
              b_k(s) = (2 / S)^(1/2) cos(pi k (2 s + 1) / (2 S))
          so that c_0 is the mean pose and the rest is movement.
place     joints are seen from the root.
heading   the direction the root faces in the first tenth of a second becomes +z.
body      forward kinematics on one skeleton for all clips, so that positions are
          functions of the angles alone (`body="one"`), or on each clip's own.

Channels are joint positions in metres of a body with an adult's legs (`size.ADULT_LEG`), so that
the unit of files does not matter, or in metres as files tell them (`lengths="file"`); or the
rotation of every joint relative to its parent (the nine entries of the matrix; of the root
relative to the heading); or both.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from scipy.fft import dct, idct

from ..errors import InputError
from ..settings import BEFORE
from .dataset import label_names, require_angles, skeletons
from .euler import reordered
from .joining import split
from .kinematics import poses
from .size import ADULT_LEG, Lengths, body_size
from .skeleton import Skeleton

Channels = Literal["positions", "rotations", "both"]
Body = Literal["one", "own"]
Pace = Literal["time", "path"]
KINDS: dict[str, tuple[str, ...]] = {
    "positions": ("positions",),
    "rotations": ("rotations",),
    "both": ("positions", "rotations"),
}
# Joints that recordings measure badly or not at all, and those that do not move.
LEAVE_OUT = ("finger", "thumb", "hipjoint", "clavicle")
HEADING_SECONDS = 0.1


@dataclass(frozen=True)
class Segmenting:
    """How segments become vectors.

    Parameters
    ----------
    channels
        ``positions`` (metres, see `lengths`), ``rotations`` (entries of rotation matrices) or
        ``both``.
    coefficients
        K, cosine coefficients kept of every channel.
    samples
        S, samples a segment is resampled to first.
    body
        ``one``: all clips on the skeleton given to `segments`; ``own``: each on its own.
    static
        Whether the mean pose (coefficient 0) is kept; without it only movement is left.
    pace
        ``time``: samples at equal steps of time; ``path``: of the way gone.
    lengths
        ``body``: positions are told in the body's own size, as if all legs were as long as an
        adult's; ``file``: in metres, or the file's unit where it does not say.
    """

    channels: Channels = "both"
    coefficients: int = 3
    samples: int = 64
    body: Body = "one"
    static: bool = True
    pace: Pace = "time"
    lengths: Lengths = field(default="body", metadata={BEFORE: "file"})

    def __post_init__(self) -> None:
        """Refuse settings that make no vector."""
        first = 0 if self.static else 1
        if not first < self.coefficients <= self.samples:
            raise InputError(
                "segments",
                f"{self.coefficients} coefficients of {self.samples} samples were asked for",
                f"Ask for at least {first + 1} and at most as many as samples",
            )
        known = (
            (KINDS, self.channels), (("one", "own"), self.body), (("time", "path"), self.pace),
            (("body", "file"), self.lengths),
        )  # fmt: skip
        for names, given in known:
            if given not in names:
                raise InputError("segments", f"there is no {given!r}", f"Use {', '.join(names)}")


def segments(
    motion: xr.Dataset, settings: Segmenting, skeleton: Skeleton | None = None
) -> xr.DataArray:
    """Describe every clip by one vector.

    Parameters
    ----------
    motion
        Clips with angles; each is one segment.
    settings
        How they become vectors.
    skeleton
        The body for all with ``body="one"``; by default that of the first clip.

    Returns
    -------
    Array (clip, channel, coefficient), NaN where an angle is missing in more than half of the
    clip, with the clips' labels as coordinates on `clip`,
    ``joint`` and ``depth`` (links between joint and root) on `channel`.

    Raises
    ------
    InputError
        If there are only markers, or skeletons differ in their joints.
    """
    known = skeletons(motion)
    if "angle" not in motion or not known:
        raise InputError(
            "segments", "the motion has no joint angles", "Use recordings with a skeleton"
        )
    parts = split(motion)
    skeleton = body_of(motion) if skeleton is None else skeleton
    rows = []
    for clip, part in parts.items():
        own = known[str(part["skeleton"].values[0])]
        rows.append(_vector(clip, part, skeleton, own, settings))
    names, joints, depths = _channels(skeleton, settings.channels)
    labels = {
        name: ("clip", [str(part[name].values[0]) for part in parts.values()])
        for name in label_names(motion)
    }
    first = 0 if settings.static else 1
    return xr.DataArray(
        np.stack(rows),
        dims=("clip", "channel", "coefficient"),
        coords={
            "clip": list(parts),
            "channel": names,
            "coefficient": np.arange(first, settings.coefficients),
            "joint": ("channel", joints),
            "depth": ("channel", depths),
            "seconds": (
                "clip",
                [part.sizes["frame"] / motion.attrs["frame_rate"] for part in parts.values()],
            ),
            **labels,
        },
        name="segment",
    )


def body_of(motion: xr.Dataset) -> Skeleton:
    """Give the skeleton of the first clip: the one body of all, where no other is given."""
    require_angles(motion)
    return skeletons(motion)[str(motion["skeleton"].values[0])]


def cosine(x: Float[np.ndarray, "s c"], coefficients: int) -> Float[np.ndarray, "k c"]:
    """Give the first cosine coefficients of every column, scaled so that c_0 is near the mean.

    The scale is S^(-1/2): the sum of squares of all coefficients is the mean square of x.
    """
    return np.asarray(dct(x, axis=0, norm="ortho"))[:coefficients] / np.sqrt(len(x))


def cosine_of_seen(x: Float[np.ndarray, "n c"], settings: Segmenting) -> Float[np.ndarray, "k c"]:
    """Return the first cosine coefficients of columns with missing rows (NaN).

    They are the least squares solution over the samples between seen rows; with all seen they
    are those of `cosine`. NaN where less than half of the samples are seen.
    """
    at = _places(x, settings.samples, settings.pace)
    basis = from_cosine(np.eye(settings.coefficients), settings.samples)
    out = np.full((settings.coefficients, x.shape[1]), np.nan)
    below, above = np.floor(at).astype(int), np.ceil(at).astype(int)
    for column, values in enumerate(x.T):
        there = np.isfinite(values)
        seen = there[below] & there[above]
        if seen.sum() >= max(settings.samples / 2, settings.coefficients):
            y = np.interp(at[seen], np.flatnonzero(there), values[there])
            out[:, column] = np.linalg.lstsq(basis[seen], y, rcond=None)[0]
    return out


def from_cosine(c: Float[np.ndarray, "k ch"], samples: int) -> Float[np.ndarray, "s ch"]:
    """Give the samples of channels from their first cosine coefficients."""
    padded = np.zeros((samples, c.shape[1]))
    padded[: len(c)] = c
    return np.asarray(idct(padded * np.sqrt(samples), axis=0, norm="ortho"))


def resampled(
    x: Float[np.ndarray, "n ..."], samples: int, pace: Pace = "time"
) -> Float[np.ndarray, "s ..."]:
    """Give samples at equal steps from the first row to the last, linear between rows.

    Steps are of rows, or of the way gone from row to row (rows that are all alike count as
    steps of rows).
    """
    flat = x.reshape(len(x), -1)
    at, rows = _places(flat, samples, pace), np.arange(len(x))
    columns = [np.interp(at, rows, column) for column in flat.T]
    return np.stack(columns, axis=1).reshape(samples, *x.shape[1:])


def _places(x: Float[np.ndarray, "n c"], samples: int, pace: Pace) -> Float[np.ndarray, " s"]:
    """Return the rows, not necessarily whole, at which samples are taken.

    Steps between rows of which nothing is seen count as nothing of the way gone.
    """
    at = np.linspace(0, len(x) - 1, samples)
    if pace == "path":
        steps = np.sqrt(np.nansum(np.square(np.diff(x, axis=0)), axis=1))
        way = np.concatenate([[0.0], steps.cumsum()])
        if way[-1] > 0:
            at = np.interp(np.linspace(0, way[-1], samples), way, np.arange(len(x)))
    return at


def _vector(
    clip: str, part: xr.Dataset, skeleton: Skeleton, own: Skeleton, settings: Segmenting
) -> np.ndarray:
    """Give the (channel, coefficient) array of one clip."""
    if sorted(own.names) != sorted(skeleton.names):
        raise InputError(
            f"clip {clip!r}",
            f"its skeleton {own.name!r} has other joints than {skeleton.name!r}",
            "Use clips whose skeletons name their joints and degrees of freedom alike",
        )
    angle = reordered(part["angle"].sel(dof=list(own.dofs)).values, own, skeleton)
    body = skeleton if settings.body == "one" else _as(skeleton, own)
    position, turned = poses(body, np.nan_to_num(angle), np.zeros((len(angle), 3)))
    own_seen, above_seen = _seen(skeleton, angle)
    facing = turned[own_seen[:, 0], 0, :, 2]
    begun = max(1, round(HEADING_SECONDS * part.attrs["frame_rate"]))
    facing = facing[:begun].mean(axis=0) if len(facing) else np.full(3, np.nan)
    back = _about_vertical(-np.arctan2(facing[0], facing[2]))
    parts = []
    for kind in KINDS[settings.channels]:
        chosen = _kept(skeleton, kind)
        if kind == "positions":
            metres = ADULT_LEG / body_size(body)
            if settings.lengths == "file":
                metres = body.metres or 1.0
            values = (position @ back.T)[:, chosen] * metres
            values = np.where(above_seen[:, chosen, None], values, np.nan)
        else:
            parents = np.array([skeleton.joints[j].parent for j in chosen])
            above = np.where(parents[:, None, None] < 0, back.T, turned[:, parents])
            values = above.swapaxes(-1, -2) @ turned[:, chosen]
            values = np.where(own_seen[:, chosen, None, None], values, np.nan)
        parts.append(values.reshape(len(values), -1))
    flat = np.concatenate(parts, axis=1)
    first = 0 if settings.static else 1
    if np.isfinite(flat).all():
        made = cosine(resampled(flat, settings.samples, settings.pace), settings.coefficients)
    else:
        made = cosine_of_seen(flat, settings)
    return made[first:].T


def _as(skeleton: Skeleton, own: Skeleton) -> Skeleton:
    """Return a skeleton with its joints and rotations in the order of another one's."""
    lengths = {joint.name: joint for joint in own}
    joints = [
        replace(joint, offset=lengths[joint.name].offset, axis=lengths[joint.name].axis)
        for joint in skeleton
    ]
    return replace(own, joints=tuple(joints))


def _seen(
    skeleton: Skeleton, angle: Float[np.ndarray, "n d"]
) -> tuple[Bool[np.ndarray, "n j"], Bool[np.ndarray, "n j"]]:
    """Tell of which joints all own angles are seen, and of which those of all joints above."""
    own = np.ones((len(angle), len(skeleton)), dtype=bool)
    above = np.ones_like(own)
    there = np.isfinite(angle)
    for index, joint in enumerate(skeleton):
        columns = [skeleton.dofs.index(f"{joint.name}/{c}") for c in joint.channels]
        own[:, index] = there[:, columns].all(axis=1)
        if joint.parent >= 0:
            above[:, index] = above[:, joint.parent] & own[:, joint.parent]
    return own, above


def _kept(skeleton: Skeleton, kind: str) -> list[int]:
    """Choose the joints that are described."""
    kept = []
    for index, joint in enumerate(skeleton):
        out = any(word in joint.name.lower() for word in LEAVE_OUT)
        useful = bool(joint.channels) if kind == "rotations" else index > 0
        if useful and not out:
            kept.append(index)
    return kept


def _channels(skeleton: Skeleton, channels: Channels) -> tuple[list[str], list[str], list[int]]:
    """Name the channels, and tell their joints and these joints' links to the root."""
    depth = [0] * len(skeleton)
    for index, joint in enumerate(skeleton):
        depth[index] = 0 if joint.parent < 0 else depth[joint.parent] + 1
    ends = {"positions": ["x", "y", "z"], "rotations": [r + c for r in "xyz" for c in "xyz"]}
    rows = [
        (index, end)
        for kind in KINDS[channels]
        for index in _kept(skeleton, kind)
        for end in ends[kind]
    ]
    return (
        [f"{skeleton.names[index]}/{end}" for index, end in rows],
        [skeleton.names[index] for index, _ in rows],
        [depth[index] for index, _ in rows],
    )


def _about_vertical(angle: float) -> np.ndarray:
    """Rotation matrix about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
