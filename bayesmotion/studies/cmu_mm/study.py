"""The board of CMU actions: 10 frames given, 25 predicted, errors in millimetres.

The protocol of Li et al. (2018) and those after, at 25 frames a second, by action: all windows of
the test file, the mean distance of 38 joints from the root 80 to 1000 ms ahead. A method sees the
contexts alone. Penalty of the ridge and settings of the process are those of the smallest mean
error over the six times on training files that are left out in turn; others' networks are trained
on eight actions together, these on one. Neighbouring windows overlap: uncertainty is that of
blocks of 35 windows drawn again.
"""

from collections.abc import Callable, Mapping
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...prediction import COVERAGES, Mixture
from ..stages import Say, Stages
from .data import (
    ACTIONS,
    CONTEXT,
    FRAMES,
    HORIZON,
    Body,
    Windows,
    errors_mm,
    read_action,
    read_body,
    together,
    windows_of,
)
from .methods import Process, Told, nearest, process, ridge, zero

Method = Callable[[Windows, Float[np.ndarray, "w k e"]], Told]
PENALTIES = (1e3, 1e4, 1e5, 1e6)
POSE_WEIGHTS, LENGTHS = (0.3, 1.0, 3.0), (0.5, 1.0, 2.0)
NOISES, LINEAR = (1e-3, 1e-2, 3e-2), (0.0, 0.3)
# Of the training windows every so many-th is used.
STRIDE = 2
BLOCK, RESAMPLES = CONTEXT + HORIZON, 2000
# Errors in mm at the times of `FRAMES` that others published.
PUBLISHED = {
    "walking": {
        "Res. sup. (2017)": (44.4, 76.7, 127, 151, 182, 194),
        "DMGNN (2020)": (9.6, 15.5, 26.0, 30.4, 37.8, 67.0),
        "LTD (2019)": (6.6, 10.7, 17.4, 20.4, 25.2, 34.4),
        "MSR-GCN (2021)": (6.3, 10.3, 17.6, 21.1, 27.2, 39.7),
        "GGMotion (2025)": (6.0, 9.6, 15.5, 18.9, 24.2, 34.0),
    },
    "running": {
        "Res. sup. (2017)": (25.8, 48.9, 88.2, 101, 124, 158),
        "DMGNN (2020)": (17.4, 26.8, 38.3, 40.1, 42.5, 46.4),
        "LTD (2019)": (14.5, 24.2, 37.4, 41.1, 43.5, 51.7),
        "MSR-GCN (2021)": (12.8, 20.4, 30.6, 34.4, 38.8, 48.0),
        "GGMotion (2025)": (11.7, 20.5, 29.9, 32.7, 36.9, 46.1),
    },
}


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict[str, Any]:
    """Choose on training files left out, forecast the test windows, write ``cmu-mm.json``.

    Parameters
    ----------
    data
        Folder that holds ``benchmarks/cmu_mm``; where None ``$BAYESMOTION_DATA``.
    out
        Folder for the results.
    say
        Called with a line after every stage.
    seed
        Of the blocks drawn again.
    """
    stages = Stages(out / "cmu-mm.json", plan(seed), say)
    body = read_body(data)
    for action in ACTIONS:
        clips = {split: read_action(split, action, data) for split in ("train", "test")}
        for split, files in clips.items():
            stages.read(**{f"{split} {name}": values for name, values in files.items()})
        train = [windows_of(body, values).every(STRIDE) for values in clips["train"].values()]
        test = together([windows_of(body, values) for values in clips["test"].values()])
        penalty = stages.do(action, "penalty", work=partial(best_penalty, body, train))
        chosen = stages.do(action, "process", work=partial(best_process, body, train))
        scale = np.array(chosen["error_scale"])
        settings = Process(*chosen["settings"])
        methods: dict[str, Method] = {
            "zero": zero,
            "nearest": nearest,
            "ridge": partial(ridge, penalty=penalty),
            "process": partial(process, settings=settings, error_scale=scale),
        }
        for name, method in methods.items():
            stages.do(action, "test", name,
                      work=partial(scored, body, together(train), test, method, seed))  # fmt: skip
    return stages.result


def plan(seed: int = 0) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "context": CONTEXT,
        "horizon": HORIZON,
        "stride": STRIDE,
        "penalties": list(PENALTIES),
        "pose_weights": list(POSE_WEIGHTS),
        "lengths": list(LENGTHS),
        "noises": list(NOISES),
        "linear": list(LINEAR),
        "block": BLOCK,
        "seed": seed,
    }


def best_penalty(body: Body, train: list[Windows]) -> float:
    """Return the ridge's penalty of the smallest mean error on files left out."""
    return min(PENALTIES, key=lambda p: _left_out(body, train, partial(ridge, penalty=p)))


def best_process(body: Body, train: list[Windows]) -> dict[str, Any]:
    """Return the settings of the smallest mean error on files left out, and what widens them."""
    grid = [Process(*each) for each in product(POSE_WEIGHTS, LENGTHS, NOISES, LINEAR)]
    errors = [_left_out(body, train, partial(process, settings=one)) for one in grid]
    best = grid[int(np.argmin(errors))]
    squares = []
    for others, left in _folds(train):
        told = process(others, left.context, best)
        assert told.sd is not None, "a process has one"
        squares.append(((left.future - told.mean) / told.sd) ** 2)
    scale = np.sqrt(np.concatenate(squares).mean(axis=(0, 2)))
    return {"settings": list(best), "error_mm": min(errors), "error_scale": scale.tolist()}


def _folds(train: list[Windows]) -> list[tuple[Windows, Windows]]:
    files = range(len(train))
    return [(together([train[j] for j in files if j != i]), train[i]) for i in files]


def _left_out(body: Body, train: list[Windows], method: Method) -> float:
    """Return the mean error in mm on files left out, over files and times."""
    errors = [
        errors_mm(body, left, method(others, left.context).mean).mean()
        for others, left in _folds(train)
    ]
    return float(np.mean(errors))


def scored(
    body: Body, train: Windows, test: Windows, method: Method, seed: int
) -> dict[str, dict[str, Any]]:
    """Return for each time ahead the error in mm with its interval, and scores of the spread."""
    told = method(train, test.context.copy())
    errors = errors_mm(body, test, told.mean)
    out: dict[str, dict[str, Any]] = {}
    for index, (milliseconds, frame) in enumerate(FRAMES.items()):
        one: dict[str, Any] = {
            "error_mm": float(errors[:, index].mean()),
            "interval": block_interval(errors[:, index], seed),
        }
        if told.sd is not None:
            one |= spread_scores(told.mean[:, frame - 1], told.sd[:, frame - 1],
                                 test.future[:, frame - 1])  # fmt: skip
        out[str(milliseconds)] = one
    return out


def spread_scores(mean: np.ndarray, sd: np.ndarray, true: np.ndarray) -> dict[str, float]:
    """Return CRPS (mm), log score and coverages of coordinates (W, E) that move."""
    moving = true.std(axis=0) > 1e-6
    told = Mixture(mean[None][:, :, moving], sd[None][:, :, moving], np.ones(1))
    seen = true[:, moving]
    away = np.abs(told.probability(seen) - 0.5)
    shares = {f"coverage{100 * s:.0f}": float((away <= 0.5 * s).mean()) for s in COVERAGES}
    crps, log_score = float(told.crps(seen).mean()), float(told.log_density(seen).mean())
    return {"crps": crps, "log_score": log_score, **shares}


def block_interval(errors: Float[np.ndarray, " w"], seed: int) -> list[float]:
    """Return the central 95 % of means of blocks of neighbouring windows drawn again."""
    blocks = [errors[i : i + BLOCK] for i in range(0, len(errors), BLOCK)]
    sums = np.array([block.sum() for block in blocks])
    counts = np.array([len(block) for block in blocks])
    chosen = np.random.default_rng(seed).integers(len(blocks), size=(RESAMPLES, len(blocks)))
    means = sums[chosen].sum(axis=1) / counts[chosen].sum(axis=1)
    return np.quantile(means, (0.025, 0.975)).tolist()


def horizons_won(result: Mapping[str, Any], action: str) -> int:
    """Return at how many times the process errs less than the ridge and GGMotion."""
    test, others = result[action]["test"], PUBLISHED[action]["GGMotion (2025)"]
    return sum(
        test["process"][str(ms)]["error_mm"] < min(test["ridge"][str(ms)]["error_mm"], other)
        for ms, other in zip(FRAMES, others, strict=True)
    )
