"""Markers that were not seen for a while, from those that were and from before and after.

In the frame in which the markers that are seen throughout a gap lie best on their mean shape, the
three coordinates of the missing marker are

    y_t = b + B x_t + r_t,    B_ij ~ N(0, s^2 / lambda),    r ~ GP(0, s^2 Matern-3/2(t / l))

with x_t the coordinates of the seen markers. r is known before and after the gap, so that what
is filled in goes on from there, and in the middle of a long gap the body's pose tells it. lambda
and l are those by which stretches as long as the gap, in which the same marker is hidden
elsewhere, are filled in best; how far off that was in each of them is the sd of the gap, as a
mixture in which they count alike.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

# Penalties in squared body sizes, and length scales of the residual in seconds.
PENALTIES = (3e-6, 3e-5, 3e-4, 3e-3)
LENGTHS_S = (0.1, 0.25, 0.5, 1.0)
HIDDEN = 16  # stretches that are hidden
NEAR_S = 1.0  # of the residual about a gap that is looked at
WINDOW = 4000  # frames about a gap that are learned from, at most
POINTS = 160  # frames of the residual, at most
JITTER = 1e-3
FEWEST = 3  # markers that have a pose


@dataclass(frozen=True)
class FilledGap:
    """A gap of one marker.

    marker
        Its column.
    frames
        (G,) of the gap.
    mean
        (G, 3) where it was.
    sds
        (S, G) of every coordinate, one row for each stretch that was hidden; they count alike.
    tried
        Whether there were any: else the sd is that of all the marker's movement.
    """

    marker: int
    frames: Int[np.ndarray, " g"]
    mean: Float[np.ndarray, "g 3"]
    sds: Float[np.ndarray, "s g"]
    tried: bool = True


def fill_marker_gaps(position: Float[np.ndarray, "t m 3"], rate: float) -> list[FilledGap]:
    """Return every gap of every marker, filled in; see the module.

    Parameters
    ----------
    position
        (T, M, 3) in any unit, NaN where a marker was not seen; something is seen of each.
    rate
        Frames a second.

    Examples
    --------
    >>> import numpy as np
    >>> from bayesmotion.gp.marker_gaps import fill_marker_gaps
    >>> t = np.arange(200.0)[:, None, None] / 30
    >>> position = np.sin(t + np.arange(12.0).reshape(4, 3))
    >>> position[90:100, 2] = np.nan
    >>> [gap] = fill_marker_gaps(position, rate=100.0)
    >>> gap.marker, gap.mean.shape
    (2, (10, 3))
    """
    seen = np.isfinite(position).all(axis=-1)
    size = _size(position, seen)
    return [
        _fill(position / size, seen, marker, frames, rate, size)
        for marker in range(position.shape[1])
        for frames in runs(~seen[:, marker])
    ]


def runs(mask: Bool[np.ndarray, " t"]) -> Iterator[Int[np.ndarray, " g"]]:
    """Yield the frames of every unbroken run of what is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    for first, after in edges.reshape(-1, 2):
        yield np.arange(first, after)


def aligned(
    position: Float[np.ndarray, "t m 3"], shape: Float[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, "t 3 3"], Float[np.ndarray, "t 3"]]:
    """Return the rotation Q and translation c of every frame: ``position ~ shape Q^T + c``."""
    centre, middle = position.mean(axis=1, keepdims=True), shape.mean(axis=0)
    products = np.einsum("tmi,mj->tij", position - centre, shape - middle)
    left, _, right = np.linalg.svd(products)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    turn = left @ right
    return turn, centre[:, 0] - turn @ middle


def _size(position: Float[np.ndarray, "t m 3"], seen: Bool[np.ndarray, "t m"]) -> float:
    """Return how far markers are from their middle, as a root mean square over whole frames."""
    frames = seen.sum(axis=1) == seen.sum(axis=1).max()
    away = position[frames] - np.nanmean(position[frames], axis=1, keepdims=True)
    return float(np.sqrt(np.nanmean(np.sum(away**2, axis=-1)))) or 1.0


def _fill(
    position: Float[np.ndarray, "t m 3"], seen: Bool[np.ndarray, "t m"], marker: int,
    gap: Int[np.ndarray, " g"], rate: float, size: float,
) -> FilledGap:  # fmt: skip
    """Fill in one gap; positions are in body sizes."""
    window = _window(seen[:, marker], gap)
    others = _seen_with(seen[window], marker, np.flatnonzero(seen[gap].all(axis=0)))
    usable = np.flatnonzero(seen[window][:, others].all(axis=1)) + window.start
    pose = _Pose.of(position[usable][:, others])
    y = pose.within(position[usable, marker][:, None])[:, 0]
    known = seen[usable, marker]
    inside = np.searchsorted(usable, gap)
    regression = _Regression(pose.coordinates, y, known)
    stretches = _hidden(known, len(gap))
    penalty, length = PENALTIES[-1], LENGTHS_S[1]
    scales = np.array([float(np.var(y[known], axis=0).mean())])
    if stretches:
        penalty, length, scales = _best(regression, stretches, rate)
    mean, variance = regression.filled(inside, penalty, length * rate, rate)
    sds = size * np.sqrt(np.outer(scales, variance))
    return FilledGap(marker, gap, size * pose.without(mean, inside), sds, bool(stretches))


def _window(known: Bool[np.ndarray, " t"], gap: Int[np.ndarray, " g"]) -> slice:
    """Return the frames about a gap that are learned from; all if a marker is not seen in them."""
    spare = max(WINDOW - len(gap), 2 * len(gap)) // 2
    window = slice(max(int(gap[0]) - spare, 0), int(gap[-1]) + spare + 1)
    return window if known[window].sum() > len(gap) else slice(0, len(known))


def _seen_with(
    seen: Bool[np.ndarray, "t m"], marker: int, others: Int[np.ndarray, " o"]
) -> Int[np.ndarray, " o"]:
    """Return those of some markers that are seen most of the time that one is."""
    return others[seen[seen[:, marker]][:, others].mean(axis=0) > 0.5] if len(others) else others


@dataclass(frozen=True)
class _Pose:
    """Where the body is in every frame, as its seen markers tell."""

    turn: Float[np.ndarray, "t 3 3"]
    place: Float[np.ndarray, "t 3"]
    coordinates: Float[np.ndarray, "t d"]

    @classmethod
    def of(cls, position: Float[np.ndarray, "t o 3"]) -> "_Pose":
        """Return it; of too few markers there is none, and the frame is the room's."""
        frames, count = position.shape[:2]
        if count < FEWEST:
            turn = np.broadcast_to(np.eye(3), (frames, 3, 3))
            return cls(turn, np.zeros((frames, 3)), position.reshape(frames, 3 * count))
        shape = position[frames // 2]
        for _ in range(4):  # the mean shape; it changes little after the first time
            some = position[:: max(frames // 500, 1)]
            turn, place = aligned(some, shape)
            shape = np.einsum("tji,tmj->mi", turn, some - place[:, None]) / len(some)
        turn, place = aligned(position, shape)
        pose = cls(turn, place, np.empty((frames, 0)))
        return cls(turn, place, pose.within(position).reshape(frames, 3 * count))

    def within(self, position: Float[np.ndarray, "t o 3"]) -> Float[np.ndarray, "t o 3"]:
        """Return positions in the body's frame."""
        return np.einsum("tji,tmj->tmi", self.turn, position - self.place[:, None])

    def without(
        self, y: Float[np.ndarray, "g 3"], frames: Int[np.ndarray, " g"]
    ) -> Float[np.ndarray, "g 3"]:
        """Return positions of one marker in the room."""
        return np.einsum("gij,gj->gi", self.turn[frames], y) + self.place[frames]


class _Regression:
    """The coordinates of a marker by those of the others, and what it leaves."""

    def __init__(
        self,
        x: Float[np.ndarray, "t d"],
        y: Float[np.ndarray, "t 3"],
        known: Bool[np.ndarray, " t"],
    ) -> None:
        self.known = known
        self.x = np.column_stack([np.ones(len(x)), x - x.mean(axis=0)])
        self.y = np.where(known[:, None], y, 0.0)
        own = self.x[known]
        self.gram, self.products = own.T @ own, own.T @ self.y[known]

    def filled(
        self, frames: Int[np.ndarray, " g"], penalty: float, length: float, rate: float
    ) -> tuple[Float[np.ndarray, "g 3"], Float[np.ndarray, " g"]]:
        """Return the mean of frames that are taken for missing, and its variance over s^2."""
        hidden = frames[self.known[frames]]
        own = self.x[hidden]
        left = np.full(self.x.shape[1], penalty * max(self.known.sum() - len(hidden), 1))
        left[0] = JITTER * penalty
        gram = self.gram - own.T @ own + np.diag(left)
        weights = np.linalg.solve(gram, self.products - own.T @ self.y[hidden])
        near = self._near(frames, rate)
        residual = self.y[near] - self.x[near] @ weights
        among = _matern(near, near, length) + JITTER * np.eye(len(near))
        across = _matern(near, frames, length)
        share = np.linalg.solve(among, across)
        mean = self.x[frames] @ weights + share.T @ residual
        return mean, np.maximum(1.0 - np.sum(across * share, axis=0), JITTER)

    def _near(self, frames: Int[np.ndarray, " g"], rate: float) -> Int[np.ndarray, " p"]:
        """Return known frames about some, more of them close by."""
        ways = []
        for step, edge in ((-1, frames[0]), (1, frames[-1])):
            reach = int(NEAR_S * rate)
            far = np.unique(np.geomspace(1, max(reach, 2), POINTS // 2).astype(int))
            at = edge + step * far
            ways.append(at[(at >= 0) & (at < len(self.known))])
        near = np.unique(np.concatenate(ways))
        return near[self.known[near]]


def _best(
    regression: _Regression, stretches: Sequence[Int[np.ndarray, " g"]], rate: float
) -> tuple[float, float, Float[np.ndarray, " s"]]:
    """Return the penalty and length (s) that fill in hidden stretches best, and s^2 of each."""
    errors, scales = {}, {}
    for penalty in PENALTIES:
        for span in LENGTHS_S:
            found = [regression.filled(s, penalty, span * rate, rate) for s in stretches]
            away = [regression.y[s] - mean for s, (mean, _) in zip(stretches, found, strict=True)]
            errors[penalty, span] = sum(float(np.sum(a**2)) for a in away)
            scales[penalty, span] = np.array([
                float(np.mean(a**2 / variance[:, None]))
                for a, (_, variance) in zip(away, found, strict=True)
            ])  # fmt: skip
    best = min(errors, key=lambda key: errors[key])
    return (*best, scales[best])


def _hidden(known: Bool[np.ndarray, " t"], length: int) -> Sequence[Int[np.ndarray, " g"]]:
    """Return stretches as long as a gap in which the marker is known, spread over the window."""
    whole = np.convolve(known, np.ones(length), mode="valid") == length
    # Not at the ends: a gap has frames before and after it.
    starts = np.flatnonzero(whole)[1:-1]
    if not len(starts):
        return []
    chosen = starts[np.unique(np.linspace(0, len(starts) - 1, HIDDEN).astype(int))]
    return [np.arange(start, start + length) for start in chosen]


def _matern(
    one: Int[np.ndarray, " a"], other: Int[np.ndarray, " b"], length: float
) -> Float[np.ndarray, "a b"]:
    apart = np.sqrt(3.0) * np.abs(one[:, None] - other) / length
    return (1.0 + apart) * np.exp(-apart)
