"""Keyposes at musical beats, chosen among energy minima, and thresholds from examples.

Perera, Kudoh and Ikeuchi, section 3: among the candidates near beats
(`bayesmotion.models.keyposes.energy`) one in the global frame wins over one in the body's frame.

The thresholds are learned from examples: among all pairs of values that occur, the pair of
the highest F1 score (harmonic mean of precision and recall), the middle one of the best.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError
from .energy import Minima, Thresholds

Source = Literal["global", "body"]
GRID = 25


@dataclass(frozen=True)
class KeyposeFrames:
    """Frames of the keyposes, growing, each with its beat and its frame of reference."""

    frame: Int[np.ndarray, " k"]
    beat: Int[np.ndarray, " k"]
    source: tuple[Source, ...]


def select(
    in_global: Minima, in_body: Minima, thresholds: tuple[Thresholds, Thresholds]
) -> KeyposeFrames:
    """Choose keyposes among the minima: global candidates win over those of the body's frame.

    Parameters
    ----------
    in_global, in_body
        Minima near the same beats.
    thresholds
        For the two frames of reference.
    """
    first, second = in_global.kept(thresholds[0]), in_body.kept(thresholds[1])
    found: dict[int, tuple[int, Source]] = {}
    for beat in range(len(first)):
        if first[beat]:
            found.setdefault(int(in_global.frame[beat]), (beat, "global"))
        elif second[beat]:
            found.setdefault(int(in_body.frame[beat]), (beat, "body"))
    frames = sorted(found)
    return KeyposeFrames(
        np.array(frames, dtype=int),
        np.array([found[frame][0] for frame in frames], dtype=int),
        tuple(found[frame][1] for frame in frames),
    )


def score(
    found: Int[np.ndarray, " k"], true: Int[np.ndarray, " t"], tolerance: int
) -> tuple[float, float]:
    """Return precision and recall of keyposes.

    Parameters
    ----------
    found, true
        Frames.
    tolerance
        A found keypose is right if a true one, not taken by another, is at most so many
        frames away.

    Returns
    -------
    Precision (1 where nothing was found) and recall (1 where nothing was to find).
    """
    left = sorted(true.tolist())
    right = 0
    for frame in sorted(found.tolist()):
        near = [other for other in left if abs(other - frame) <= tolerance]
        if near:
            left.remove(near[0])
            right += 1
    precision = right / len(found) if len(found) else 1.0
    recall = right / len(true) if len(true) else 1.0
    return precision, recall


def learn_thresholds(examples: Sequence[tuple[Minima, np.ndarray]], tolerance: int) -> Thresholds:
    """Learn T_1 and T_2 in one frame of reference from motions whose keyposes are known.

    Parameters
    ----------
    examples
        Minima near the beats, and the frames of the true keyposes.
    tolerance
        As for `score`.

    Raises
    ------
    InputError
        If no example has a minimum near a beat.
    """
    energies = np.concatenate([m.energy[m.frame >= 0] for m, _ in examples])
    depths = np.concatenate([m.depth[m.frame >= 0] for m, _ in examples])
    if not len(energies):
        raise InputError(
            "thresholds",
            "no example has a minimum near a beat",
            "Check the beats, or widen the window",
        )
    lows, deeps = _between(energies), _between(depths)
    value = np.zeros((len(lows), len(deeps)))
    for i, low in enumerate(lows):
        for j, deep in enumerate(deeps):
            value[i, j] = _f1(examples, Thresholds(low, deep), tolerance)
    best = np.argwhere(value >= value.max() - 1e-12)
    # Of equally good pairs the one nearest to the middle of them all.
    middle = best[np.square(best - best.mean(axis=0)).sum(axis=1).argmin()]
    return Thresholds(float(lows[middle[0]]), float(deeps[middle[1]]))


NEVER = Thresholds(-np.inf, np.inf)


def learn_both(
    examples: Sequence[tuple[Minima, Minima, np.ndarray]], tolerance: int
) -> tuple[Thresholds, Thresholds]:
    """Learn thresholds of both frames of reference.

    First those of the global frame; then those of the body's frame, for the keyposes that
    the global frame missed. They are kept only if the two together score better than the
    global frame alone.

    Parameters
    ----------
    examples
        Minima in the global and the body's frame near the same beats, and the true frames.
    tolerance
        As for `score`.
    """
    first = learn_thresholds([(g, true) for g, _, true in examples], tolerance)
    rest = []
    for g, b, true in examples:
        taken = g.kept(first)
        left = [k for k in true if not (np.abs(g.frame[taken] - k) <= tolerance).any()]
        rest.append((Minima(np.where(taken, -1, b.frame), b.energy, b.depth), np.array(left, int)))
    if not any(len(left) for _, left in rest) or not any((b.frame >= 0).any() for b, _ in rest):
        return first, NEVER
    second = learn_thresholds(rest, tolerance)
    alone, both = (
        _f1_of([(select(g, b, (first, other)).frame, true) for g, b, true in examples], tolerance)
        for other in (NEVER, second)
    )
    return (first, second) if both > alone else (first, NEVER)


def _f1(
    examples: Sequence[tuple[Minima, np.ndarray]],
    thresholds: Thresholds,
    tolerance: int,
) -> float:
    """Return the F1 score of the minima that thresholds keep."""
    found = [(np.unique(m.frame[m.kept(thresholds)]), true) for m, true in examples]
    return _f1_of(found, tolerance)


def _f1_of(found: Sequence[tuple[np.ndarray, np.ndarray]], tolerance: int) -> float:
    """Harmonic mean of precision and recall over all examples together."""
    right = sum(score(frames, true, tolerance)[1] * len(true) for frames, true in found)
    total = sum(len(frames) + len(true) for frames, true in found)
    return 2.0 * right / max(total, 1)


def _between(values: Float[np.ndarray, " v"]) -> np.ndarray:
    """Return thresholds between the values, and one beyond each end."""
    ordered = np.unique(values)
    if len(ordered) > GRID:
        ordered = np.quantile(ordered, np.linspace(0.0, 1.0, GRID))
    margin = 0.05 * (ordered[-1] - ordered[0]) + 1e-9
    middles = 0.5 * (ordered[1:] + ordered[:-1])
    return np.concatenate([[ordered[0] - margin], middles, [ordered[-1] + margin]])
