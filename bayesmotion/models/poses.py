"""From a Motion to the arrays a pose model sees, and back.

`PoseEncoding` is learned from the training clips once (layout of the features,
mean and spread of each, angles of the joints left out) and then used on every
clip, so that training and new clips meet the program in the same units.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float, Int

from ..errors import InputError
from ..gp.linalg import AnyArray
from ..gp.matrix_normal import Patterns, patterns
from ..motion.dataset import clips, skeleton_of, skeletons
from ..motion.features import Layout, decode, encode, heading_of, layout_of
from ..motion.joining import split
from ..priors.dynamics import Steps, steps_of

UNKNOWN = ""
# Radians: the standard deviation of an angle that does not move, but for the digits of a file.
STILL = 1e-4


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Frames:
    """What a pose model is given: N frames of C clips, D features.

    y
        (N, D) features, centred and scaled; zero where not seen.
    missing
        Which entries are seen.
    clip
        (N,) clip of each frame.
    time
        (N,) frames from the middle of the clip.
    level
        For each factor (C,): the level of each clip.
    steps
        First frame of each clip, and the pairs of frames that follow each other.
    frame_rate
        Frames a second.
    levels
        For each factor the number of levels (static).
    """

    y: Float[Array, "n d"] | Float[np.ndarray, "n d"]
    missing: Patterns
    clip: Int[Array, " n"] | Int[np.ndarray, " n"]
    time: Float[Array, " n"] | Float[np.ndarray, " n"]
    level: dict[str, Int[Array, " c"] | Int[np.ndarray, " c"]]
    steps: Steps
    frame_rate: Float[AnyArray, ""]
    levels: tuple[int, ...] = field(metadata={"static": True})

    @property
    def n_clips(self) -> int:
        """Number of clips C."""
        return self.steps.first.shape[0]


@dataclass(frozen=True)
class PoseEncoding:
    """How poses become features of unit spread, learned from training clips.

    layout
        Layout of the features.
    mean, spread
        (D,) mean and standard deviation, of angles at least `STILL`.
    still
        (D,) which features never change in training. They tell nothing of styles and content;
        as columns of zeros they would call for a process without any variance.
    rest
        Mean angle of every degree of freedom, for those left out of the features.
    frame_rate
        Frames a second; other clips must have the same.
    turned
        Whether each clip's heading is taken out.
    """

    layout: Layout
    mean: Float[np.ndarray, " d"]
    spread: Float[np.ndarray, " d"]
    still: Bool[np.ndarray, " d"]
    rest: dict[str, float]
    frame_rate: float
    turned: bool

    @property
    def n_angles(self) -> int:
        """Number of angular features; they come first."""
        return self.layout.n_angles

    def heading(self, motion: xr.Dataset) -> float:
        """Heading that is taken out of a clip, zero where headings are kept."""
        return heading_of(motion) if self.turned else 0.0

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
                "Bring it to that rate with downsample()",
            )
        return encode(motion, self.layout, heading, self.mean[: self.n_angles])

    def scaled(self, features: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Centre and scale features."""
        return (features - self.mean) / self.spread

    def told(self, features: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Centre and scale features, NaN for those that never change in training."""
        return np.where(self.still, np.nan, self.scaled(features))

    def unscaled(self, y: Float[np.ndarray, "*s n d"]) -> Float[np.ndarray, "*s n d"]:
        """Undo `scaled`."""
        return np.asarray(y) * self.spread + self.mean

    def motion(
        self,
        y: Float[np.ndarray, "n d"],
        skeleton,
        *,
        clip: str,
        start: Float[np.ndarray, " 3"],
        heading: float = 0.0,
        labels: dict[str, str] | None = None,
        source: str = "",
    ) -> xr.Dataset:
        """Make a Motion of scaled features, on any skeleton with the layout's joints."""
        return decode(
            self.unscaled(y),
            self.layout,
            skeleton,
            frame_rate=self.frame_rate,
            clip=clip,
            start=start,
            rest=self.rest,
            heading=heading,
            labels=labels,
            source=source,
        )


def learn_encoding(motion: xr.Dataset, *, turned: bool = False) -> PoseEncoding:
    """Learn the encoding from training clips.

    Features are centred: exporters differ in what pose has angles of zero, and a mean pose
    far from zero would have to be explained by what does not repeat with the content.

    Raises
    ------
    InputError
        If the skeletons do not share one layout.
    """
    layouts = {name: layout_of(skeleton) for name, skeleton in skeletons(motion).items()}
    first, layout = next(iter(layouts.items()))
    for name, other in layouts.items():
        if other != layout:
            raise InputError(
                f"skeletons {first!r} and {name!r}",
                "their joints give different pose features",
                "Train on clips whose skeletons have the same joints",
            )
    y = np.concatenate(_alike(split(motion), layout, turned))
    mean = np.nanmean(y, axis=0)
    spread = np.nanstd(y, axis=0)
    still = spread <= 1e-12 * np.maximum(np.abs(mean), 1.0)
    angles = layout.n_angles
    still[: 2 * angles] |= np.tile(spread[:angles] < STILL, 2)
    rest = {str(dof): float(motion["angle"].sel(dof=dof).mean()) for dof in motion["dof"].values}
    return PoseEncoding(
        layout,
        mean,
        np.where(still, np.maximum(spread, STILL), spread),
        still,
        rest,
        motion.attrs["frame_rate"],
        turned,
    )


def _alike(
    parts: Mapping[str, xr.Dataset], layout: Layout, turned: bool
) -> list[Float[np.ndarray, "n d"]]:
    """Features of clips, their exponential maps near those of the first clip."""
    out: list[np.ndarray] = []
    for part in parts.values():
        near = out[0][len(out[0]) // 2, : layout.n_angles] if out else None
        out.append(encode(part, layout, heading_of(part) if turned else 0.0, near))
    return out


def level_names(motion: xr.Dataset, factor: str) -> list[str]:
    """Give the known levels of a factor in order of appearance."""
    return [name for name in dict.fromkeys(motion[factor].values.tolist()) if name != UNKNOWN]


def frames_of(
    parts: Mapping[str, Float[np.ndarray, "n d"]],
    labels: Mapping[str, Mapping[str, str]],
    known: Mapping[str, list[str]],
    given: Patterns | None = None,
    length: int | None = None,
    *,
    frame_rate: float,
) -> Frames:
    """Put scaled features of clips together for a program.

    Parameters
    ----------
    parts
        Scaled features (N_c, D) of each clip, NaN where not seen.
    labels
        For each factor the clips' labels, "" where unknown.
    known
        For each factor the levels that exist already; they come first. Labels that are
        not among them become new levels, and every unknown label is a level of its own.
    given
        Patterns of the training data, where the program is conditioned on them.
    length
        Frames that a clip's middle is counted from; all of the clip where None. A
        clip that goes on keeps its phase and step with the length it had before.
    frame_rate
        Frames a second of the clips.
    """
    y = np.concatenate(list(parts.values()))
    sizes = [len(part) for part in parts.values()]
    seen = np.isfinite(y)
    level, counts = {}, []
    for factor, names in known.items():
        level[factor], count = _levels(list(parts), labels[factor], names)
        counts.append(count)
    return Frames(
        y=np.where(seen, y, 0.0),
        missing=patterns(seen, given),
        clip=np.repeat(np.arange(len(sizes)), sizes),
        time=np.concatenate([np.arange(n) - ((length or n) - 1) / 2.0 for n in sizes]),
        level=level,
        steps=steps_of(sizes),
        frame_rate=np.array(frame_rate, dtype=float),
        levels=tuple(counts),
    )


def seen_entries_of(frames: Frames) -> np.ndarray:
    """Return which entries (N, D) are seen."""
    return np.einsum("pn,pd->nd", frames.missing.rows, frames.missing.columns) > 0


def _levels(
    names: list[str], labels: Mapping[str, str], known: list[str]
) -> tuple[np.ndarray, int]:
    index = {level: position for position, level in enumerate(known)}
    out, count = [], len(known)
    for clip in names:
        label = labels.get(clip, UNKNOWN)
        if label == UNKNOWN:
            out.append(count)
            count += 1
            continue
        if label not in index:
            index[label] = count
            count += 1
        out.append(index[label])
    return np.array(out), count


def clip_labels(motion: xr.Dataset, factor: str) -> dict[str, str]:
    """Give each clip's label of a factor.

    Raises
    ------
    InputError
        If the motion has no such label or a clip changes it on the way.
    """
    if factor not in motion.coords:
        raise InputError(
            f"clips {', '.join(clips(motion))}",
            f"they have no label {factor!r}",
            f"Label them with with_labels(), an empty text where {factor} is unknown",
        )
    out = {}
    for clip, part in split(motion).items():
        values = sorted(set(part[factor].values.tolist()))
        if len(values) > 1:
            raise InputError(
                f"clip {clip!r}",
                f"its {factor} changes from {values[0]!r} to {values[1]!r}",
                "Cut it into clips with one label each",
            )
        out[clip] = values[0]
    return out


__all__ = [
    "UNKNOWN",
    "Frames",
    "PoseEncoding",
    "clip_labels",
    "frames_of",
    "learn_encoding",
    "level_names",
    "seen_entries_of",
    "skeleton_of",
]
