"""One harness for boards: methods see a clip's first frames alone, and are scored on the rest.

A method is a function of the context (K, D) that gives a `Mixture` of every entry of the frames
that follow. `forecasts` hands it a copy of the context and nothing else. Methods that run elsewhere
read `write_given` and hand in a file, which `read_predictions` refuses unless it has the frames
to predict, and those alone:

    <clip>/mean     (H, D), or (S, H, D) for a mixture
    <clip>/sd       the same shape; without it only errors are scored
    <clip>/weight   (S,), where there is a mixture; alike where it is not given

``python -m bayesmotion.studies.boards.harness cmu35 predictions.npz`` scores such a file.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ...errors import InputError
from ...files import replacing
from ...prediction import COVERAGES, Mixture

Method = Callable[[Float[np.ndarray, "k d"], int], Mixture]
# Of any length each.
Clips = dict[str, Float[np.ndarray, "_ d"]]
RESAMPLES = 10_000
# Components of a mixture of which the CRPS is taken: its cost grows with their square.
MOST_COMPONENTS = 32


@dataclass(frozen=True)
class Board:
    """A public benchmark of forecasts.

    name
        Its name.
    train, test
        Clips (N, D) by name, in `unit`.
    context
        Frames that are given of a clip.
    frame_rate
        Frames a second.
    unit
        Of the entries.
    """

    name: str
    train: Clips
    test: Clips
    context: int
    frame_rate: float
    unit: str = "degrees"

    @property
    def moving(self) -> Bool[np.ndarray, " d"]:
        """Columns that are not constant in training: what CRPS and coverage are told of."""
        return np.concatenate([*self.train.values()]).std(axis=0) > 1e-3

    def horizon(self, clip: str) -> int:
        """Return the number of frames to predict of a test clip."""
        return len(self.test[clip]) - self.context


def forecasts(board: Board, method: Method) -> dict[str, Mixture]:
    """Return what a method predicts of every test clip, from copies of the contexts."""
    found = {}
    for name, clip in board.test.items():
        told = method(clip[: board.context].copy(), board.horizon(name))
        found[name] = _checked(board, name, told.mean, told.sd, told.weight, "the method")
    return found


def clip_scores(board: Board, clip: str, told: Mixture, *, spread: bool = True) -> dict[str, float]:
    """Score a forecast of one clip by what happened.

    Parameters
    ----------
    board, clip
        Which clip of which board.
    told
        The forecast of the frames after the context.
    spread
        Whether the forecast says how sure it is; else only errors are scored.

    Returns
    -------
    ``mse`` over frames and all columns, of the mixture's mean; and of the columns that move
    ``crps``, ``log_score`` (a mean over entries) and ``coverage50`` and so on.

    Examples
    --------
    >>> import numpy as np
    >>> from bayesmotion.prediction import Mixture
    >>> from bayesmotion.studies.boards.harness import Board, clip_scores
    >>> y = np.outer(np.sin(np.arange(9.0)), [1.0, 2.0])
    >>> board = Board("example", {"a": y}, {"b": y}, 3, 30.0)
    >>> told = Mixture(y[None, 3:], np.ones((1, 6, 2)), np.ones(1))
    >>> clip_scores(board, "b", told)["mse"]
    0.0
    """
    true = board.test[clip][board.context :]
    out = {"mse": float(np.mean((told.means() - true) ** 2))}
    if not spread:
        return out
    part, seen = told.part(slice(None), board.moving), true[:, board.moving]
    away = np.abs(part.probability(seen) - 0.5)
    out |= {
        "crps": float(thinned(part, MOST_COMPONENTS).crps(seen).mean()),
        "log_score": float(part.log_density(seen).mean()),
    }
    return out | {f"coverage{100 * s:.0f}": float((away <= 0.5 * s).mean()) for s in COVERAGES}


def summary(clips: Mapping[str, Mapping[str, float]], seed: int = 0) -> dict[str, Any]:
    """Return the means of scores over clips, standard errors, and intervals of resampled clips.

    Parameters
    ----------
    clips
        Scores of every clip.
    seed
        Of the resampling.

    Returns
    -------
    For each score ``mean``, ``se`` and ``interval``, the central 95 % of the means of clips
    drawn again with replacement.
    """
    random = np.random.default_rng(seed)
    chosen = random.integers(len(clips), size=(RESAMPLES, len(clips)))
    out = {}
    for name in next(iter(clips.values())):
        each = np.array([one[name] for one in clips.values()])
        se = float(each.std(ddof=1) / np.sqrt(len(each))) if len(each) > 1 else float("nan")
        interval = np.quantile(each[chosen].mean(axis=1), (0.025, 0.975)).tolist()
        out[name] = {"mean": float(each.mean()), "se": se, "interval": interval}
    return out


def thinned(mixture: Mixture, count: int) -> Mixture:
    """Return a mixture of at most so many components alike in weight, evenly drawn by weight."""
    if len(mixture.weight) <= count:
        return mixture
    order = np.argsort(-mixture.weight, kind="stable")
    edges = np.cumsum(mixture.weight[order])
    at = np.searchsorted(edges, edges[-1] * (np.arange(count) + 0.5) / count)
    chosen = order[np.minimum(at, len(order) - 1)]
    return Mixture(mixture.mean[chosen], mixture.sd[chosen], np.full(count, 1.0 / count))


def write_given(board: Board, path: Path) -> None:
    """Write what a method may see: training clips, contexts, and how many frames to predict."""
    arrays: dict[str, Any] = {f"train/{name}": clip for name, clip in board.train.items()}
    for name, clip in board.test.items():
        arrays[f"context/{name}"] = clip[: board.context]
        arrays[f"horizon/{name}"] = np.array(board.horizon(name))
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **arrays)


def read_predictions(board: Board, path: Path) -> dict[str, tuple[Mixture, bool]]:
    """Return a file's forecasts, and of each whether it says how sure it is; see the module.

    Raises
    ------
    InputError
        If a clip is missing, or an array has other frames or columns than are to be predicted.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except (OSError, ValueError) as error:
        raise InputError(path, f"it cannot be read ({error})", "Give an .npz file") from error
    found = {}
    for name in board.test:
        if f"{name}/mean" not in arrays:
            raise InputError(path, f"it has no {name}/mean", "Predict every test clip")
        mean = np.asarray(arrays[f"{name}/mean"], dtype=float)
        spread = f"{name}/sd" in arrays
        sd = np.asarray(arrays[f"{name}/sd"], dtype=float) if spread else np.ones(mean.shape)
        if mean.ndim == 2:
            mean, sd = mean[None], sd[None]
        weight = arrays.get(f"{name}/weight", np.full(len(mean), 1.0 / max(len(mean), 1)))
        found[name] = (_checked(board, name, mean, sd, weight, path), spread)
    return found


def score_file(board: Board, path: Path) -> dict[str, Any]:
    """Return scores of a file of predictions: of every clip, and over clips."""
    told = read_predictions(board, path)
    spread = all(spread for _, spread in told.values())
    clips = {n: clip_scores(board, n, one, spread=spread) for n, (one, _) in told.items()}
    return {"clips": clips, "over_clips": summary(clips)}


def _checked(
    board: Board, clip: str, mean: np.ndarray, sd: np.ndarray, weight: np.ndarray, where: object
) -> Mixture:
    """Return a forecast that has the frames to predict, and those alone."""
    wanted = (board.horizon(clip), board.test[clip].shape[1])
    if mean.ndim != 3 or mean.shape[1:] != wanted or sd.shape != mean.shape:
        raise InputError(
            where,
            f"of clip {clip!r} it has mean {mean.shape} and sd {sd.shape}",
            f"Predict {wanted[0]} frames of {wanted[1]} columns, those after the first "
            f"{board.context}, and no others",
        )
    good = np.isfinite(mean).all() and (sd > 0.0).all() and np.isfinite(sd).all()
    if not good or weight.shape != mean.shape[:1] or not np.isclose(weight.sum(), 1.0):
        raise InputError(
            where,
            f"of clip {clip!r} a mean or sd is not finite, an sd is not positive, or weights "
            "do not add up to one",
            "Correct the predictions",
        )
    return Mixture(mean, sd, weight)


def main(name: str, path: str, data: str | None = None) -> None:
    """Print the scores of a file of predictions for a board."""
    from .data import read_board

    board = read_board(name, None if data is None else Path(data))
    for score, one in score_file(board, Path(path))["over_clips"].items():
        low, high = one["interval"]
        print(f"{score}: {one['mean']:.3f} (95 % over clips {low:.3f} to {high:.3f})")


if __name__ == "__main__":
    main(*sys.argv[1:])
