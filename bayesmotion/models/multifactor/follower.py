"""A new clip of the multifactor model as it comes: its window, its groups, where it may begin."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float, Int

from ...distributions.circle import circle
from ...gp.followed import Rows
from ...model import Units
from ...verbs import Arrival
from .data import PoseData
from .following import Following, Known, Window, following
from .frames import Frames, frames_of
from .new_clips import as_clip
from .program import MultifactorProgram
from .recent import RecentPoses

# Groups of columns that are kept apart by what was seen of them, in the past and in a window.
GROUPS = 8
# Training frames that a frame is compared with, at most, and what of an older frame's distance
# counts a frame later.
COMPARED, LASTS = 4096, 0.9
# Candidates of one training clip are at least this part of a cycle apart.
APART = 1.0 / 12.0


class ClipFollower:
    """The frames of a new clip, as `verbs.Follower` says.

    Parameters
    ----------
    model, training
        The model, with content on a circle, and the training clips.
    values
        Draws (S, ...) of all sites.
    labels
        What is known of the clip.
    window, horizon
        Numbers of frames.

    Raises
    ------
    InputError
        If the model's clips cannot be followed.
    """

    def __init__(
        self,
        model: MultifactorProgram,
        training: PoseData,
        values: Mapping[str, Array],
        labels: Mapping[str, str],
        window: int,
        horizon: int,
    ) -> None:
        self.process: Following = following(model, np.asarray(values["gamma"]))
        self._training, self._size = training.frames, window
        self._poses = RecentPoses(training.encoding, window)
        self._ahead = _levels(training, labels, window + horizon)
        patterns = training.frames.missing
        # Columns are of one group of the past while they were seen in the same frames.
        self._history = np.argmax(np.asarray(patterns.columns), axis=0)
        self._which = np.arange(len(patterns.columns))
        self._rows = np.zeros((0, len(self._history)))
        self._compared = _Compared(training.frames)

    @property
    def units(self) -> Units:
        """Units of the features."""
        encoding = self._poses.encoding
        return Units(encoding.mean, encoding.sd)

    def add(self, frame: xr.Dataset) -> Arrival:
        """Put a frame behind the others."""
        before = self._rows
        self._poses.add(frame)
        self._rows = self._poses.features()
        self._compared.add(self._rows[-1])
        full = len(before) == self._size
        left = self._leave(np.isfinite(before[0])) if full else None
        filled = len(self._rows)
        shift = 1.0 if full else 0.5 * (filled - len(before))
        return Arrival(self._window(), left, shift if len(before) else 0.0)

    def motion(self, features: Float[np.ndarray, "n d"], clip: str) -> xr.Dataset:
        """Return features of the frames to come, in their own units, as a Motion."""
        return self._poses.motion(self.units.scaled(features), clip)

    def candidates(self, given: Known, count: int) -> list[dict[str, np.ndarray]]:
        """Return values of the unknowns where the search may begin, the likeliest first.

        They are those of training clips at the frames that the last ones look most like.
        """
        trained = given.trained
        model, middle = self.process.model, (len(self._rows) - 1) / 2.0
        wander = {"wander": np.zeros((1, 2))} if model.wander_sd else {}
        content = np.asarray(trained.points["content"])
        turned = np.arctan2(content[:, 1], content[:, 0])
        step, clips = np.asarray(trained.values["step"]), np.asarray(self._training.clip)
        out, taken = [], []
        for frame in self._compared.nearest():
            clip, angle = int(clips[frame]), float(turned[frame])
            of_clip = np.array([other for of, other in taken if of == clip])
            if np.any(np.abs(np.angle(np.exp(1j * (angle - of_clip)))) < 2.0 * np.pi * APART):
                continue
            taken.append((clip, angle))
            phase = angle - step[clip] * middle
            own = as_clip(model, self._ahead, trained, clip)
            at = {"phase_point": np.asarray(circle(np.array([phase]))), "step": step[[clip]]}
            out.append({**own, **wander, **at})
            if len(out) == count:
                break
        return out

    def _window(self) -> Window:
        """Return the window, its columns grouped by what is seen of them."""
        seen = np.isfinite(self._rows)
        group, parent = _groups(self._history, seen)
        known = np.zeros((len(parent), self._size))
        rows = np.zeros((self._size, len(group)))
        for index in range(len(parent)):
            known[index, : len(seen)] = seen[:, group == index].all(axis=1)
        columns = (np.arange(len(parent))[:, None] == group).astype(float)
        used = known[group, : len(seen)].T > 0.0
        rows[: len(seen)] = np.where(used, self._rows, 0.0)
        filled = np.array(len(seen))
        return Window(Rows(rows, known, columns, parent, filled), self._which[parent], self._ahead)

    def _leave(self, seen: Bool[np.ndarray, " d"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return how the past is split by a frame that leaves; see `verbs.Arrival`."""
        group, parent = _groups(self._history, seen[None])
        known = np.array([float(seen[group == index].all()) for index in range(len(parent))])
        self._history, self._which = group, self._which[parent]
        return parent, known, group


def _groups(
    history: Int[np.ndarray, " d"], seen: Bool[np.ndarray, "n d"]
) -> tuple[Int[np.ndarray, " d"], Int[np.ndarray, " g"]]:
    """Return the group of every column, and of which group of the past each is part.

    Groups are filled up to a power of two of them, so that few programs are compiled, by ones
    without columns. Where there would be more than `GROUPS` those of the past stay together.
    """
    keys = np.concatenate([history[None], seen])
    unique, group = np.unique(keys, axis=1, return_inverse=True)
    group, parent = group.ravel(), unique[0].astype(int)
    if len(parent) > GROUPS:
        parent, group = np.unique(history, return_inverse=True)
    size = 1 << (len(parent) - 1).bit_length()
    return group, np.concatenate([parent, np.zeros(size - len(parent), int)])


def _levels(training: PoseData, labels: Mapping[str, str], frames: int) -> Frames:
    """Return frames of one clip without outputs, of these labels; others are new levels."""
    known = {
        factor: [*names, *(f"\0{i}" for i in range(count - len(names)))]
        for (factor, names), count in zip(
            training.levels.items(), training.frames.levels, strict=True
        )
    }
    own = {factor: {"": labels.get(factor, "")} for factor in known}
    empty = {"": np.full((frames, training.frames.y.shape[1]), np.nan)}
    rate = training.encoding.frame_rate
    return frames_of(empty, own, known, training.frames.missing, frame_rate=rate)


class _Compared:
    """How far the last frames are from stretches of training clips, by their last frames."""

    def __init__(self, training: Frames) -> None:
        clips = np.asarray(training.clip)
        # Of many recordings the beginnings of clips evenly spread among all.
        each = max(COMPARED // max(training.n_clips, 1), 64)
        among = np.linspace(0, training.n_clips - 1, min(training.n_clips, COMPARED // each))
        within = np.arange(len(clips)) - np.asarray(training.steps.first)[clips]
        self._frames = np.flatnonzero(np.isin(clips, among.astype(int)) & (within < each))
        self._first = within[self._frames] == 0
        rows = np.einsum("pn,pd->nd", training.missing.rows, training.missing.columns) > 0
        self._y, self._seen = np.asarray(training.y)[self._frames], rows[self._frames]
        self._total, self._count = np.zeros(len(self._frames)), np.zeros(len(self._frames))

    def add(self, y: Float[np.ndarray, " d"]) -> None:
        seen = np.isfinite(y)
        both = self._seen & seen
        away = np.sum(both * (self._y - np.where(seen, y, 0.0)) ** 2, axis=1)
        self._total = LASTS * self._before(self._total) + away
        self._count = LASTS * self._before(self._count) + both.sum(axis=1)

    def nearest(self) -> Int[np.ndarray, " n"]:
        """Return the frames of training, the nearest first."""
        mean = self._total / np.maximum(self._count, 1e-9)
        return self._frames[np.argsort(np.where(self._count > 0.0, mean, np.inf), kind="stable")]

    def _before(self, of_frames: np.ndarray) -> np.ndarray:
        return np.where(self._first, 0.0, np.roll(of_frames, 1))
