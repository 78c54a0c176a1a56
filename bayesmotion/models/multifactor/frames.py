"""The arrays that the multifactor program sees: frames of clips, and the levels of factors."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array, Float, Int

from ...distributions.dynamics import Steps, steps_of
from ...errors import InputError
from ...gp.linalg import AnyArray
from ...gp.markov import Lanes, lanes_of
from ...gp.matrix_normal import Patterns, patterns
from ...motion.dataset import clips
from ...motion.joining import split

UNKNOWN = ""


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
    lanes
        Where the frames lie to be filtered.
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
    lanes: Lanes
    frame_rate: Float[AnyArray, ""]
    levels: tuple[int, ...] = field(metadata={"static": True})

    @property
    def n_clips(self) -> int:
        """Number of clips C."""
        return self.steps.first.shape[0]


def level_names(motion: xr.Dataset, factor: str) -> list[str]:
    """Give the known levels of a factor in order of appearance."""
    return [name for name in dict.fromkeys(motion[factor].values.tolist()) if name != UNKNOWN]


def frames_of(
    parts: Mapping[str, Float[np.ndarray, "n d"]],
    labels: Mapping[str, Mapping[str, str]],
    known: Mapping[str, list[str]],
    trained: Patterns | None = None,
    lengths: Mapping[str, int] | None = None,
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
    trained
        Patterns of the training data, where the program is conditioned on them.
    lengths
        Frames that each clip's middle is counted from; all of the clip where None. A
        clip that goes on keeps its phase and step with the length it had before.
    frame_rate
        Frames a second of the clips.
    """
    y = np.concatenate(list(parts.values()))
    sizes = [len(part) for part in parts.values()]
    seen = np.isfinite(y)
    counted = lengths or {clip: len(part) for clip, part in parts.items()}
    level, counts = {}, []
    for factor, names in known.items():
        level[factor], count = _levels(list(parts), labels[factor], names)
        counts.append(count)
    return Frames(
        y=np.where(seen, y, 0.0),
        missing=patterns(seen, trained),
        clip=np.repeat(np.arange(len(sizes)), sizes),
        time=np.concatenate(
            [np.arange(len(part)) - (counted[clip] - 1) / 2.0 for clip, part in parts.items()]
        ),
        level=level,
        steps=steps_of(sizes),
        lanes=lanes_of(sizes),
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
