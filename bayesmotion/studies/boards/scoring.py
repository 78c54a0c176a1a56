"""What the studies of boards of channels do: simple forecasts and the multifactor model, scored."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from .baselines import HARMONICS, Point, cycle_method, hold, nearest, with_sd, zero
from .harness import Board, Method, clip_scores, forecasts, summary
from .linear import autoregression, ridge
from .multifactor import FACTOR, View, method_of, take_model, train

SIMPLE = ("hold", "zero", "nearest", "cycle", "mixed")
CYCLES: dict[str, dict[str, Any]] = {
    "cycle": {"mixed": False},
    "mixed": {"mixed": True},
    # Of short clips few harmonics are told.
    "mixed smoothly": {"mixed": True, "harmonics": HARMONICS // 2},
}
POINTS: dict[str, Point] = {
    "hold": hold, "zero": zero, "nearest": nearest, "ridge": ridge,
    "autoregression": autoregression,
}  # fmt: skip


def baseline(board: Board, name: str) -> Method:
    """Return a simple forecast told by a board's training clips."""
    if name in CYCLES:
        return cycle_method(board.train, board.frame_rate, **CYCLES[name])
    horizon = max(board.horizon(clip) for clip in board.test)
    return with_sd(POINTS[name], board.train, horizon, board.context)


def scored(board: Board, make: Callable[[], Method]) -> dict[str, Any]:
    """Return the scores of a method on the test clips: of each, and over them."""
    told = forecasts(board, make())
    clips = {name: clip_scores(board, name, one) for name, one in told.items()}
    return {"clips": clips, "over_clips": summary(clips)}


def left_out_baseline(board: Board, name: str) -> dict[str, dict[str, float]]:
    """Return the scores of a simple forecast of every training clip, told by all others."""
    found = {}
    for clip, y in board.train.items():
        others = {n: c for n, c in board.train.items() if n != clip}
        apart = replace(board, train=others, test={clip: y})
        told = forecasts(apart, baseline(apart, name))
        found[clip] = clip_scores(apart, clip, told[clip])
    return found


def choose(found: dict[str, dict[str, dict[str, dict[str, float]]]]) -> dict[str, Any]:
    """Return the size and view of the highest mean log score over the clips left out."""
    means = {
        (size, view): float(np.mean([one["log_score"] for one in clips.values()]))
        for size, views in found.items()
        for view, clips in views.items()
    }
    size, view = max(means, key=lambda key: means[key])
    return {"size": int(size), "view": view}


def of_model(
    board: Board, chosen: Mapping[str, Any], views: Mapping[str, View], max_steps: int, seed: int
) -> dict[str, Any]:
    """Fit the model as chosen to a board's training clips, and score it on the test clips."""
    model = take_model(chosen["size"], views[chosen["view"]])
    taught = train(board.train, board.frame_rate, model, max_steps, seed)
    one = taught.fit
    values, stats = one.values(), one.stats()
    told = scored(board, lambda: method_of(taught, board.frame_rate))
    return told | {
        "converged": bool(stats["converged"]),
        "steps": int(stats["steps"]),
        "fit_seconds": float(one.tree.attrs["seconds"]),
        "periods": (2.0 * np.pi / np.asarray(values["step"])).tolist(),
        "styles": np.asarray(values[f"style_{FACTOR}"]).tolist(),
    }
