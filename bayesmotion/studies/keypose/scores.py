"""Shares with their intervals, and calibration, of the recognition study."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import beta

from ...tasks.recognize import best_levels

MODES = ("subject", "task")
TITLES = {"subject": "person", "task": "task"}
BINS = 10
Named = dict[str, dict[str, list[str]]]


def interval(right: int, n: int, level: float = 0.95) -> list[float]:
    """Give the exact (Clopper and Pearson) interval of a share."""
    tail = 0.5 * (1.0 - level)
    low = beta.ppf(tail, right, n - right + 1) if right else 0.0
    high = beta.ppf(1.0 - tail, right + 1, n - right) if right < n else 1.0
    return [float(low), float(high)]


def accuracies(named: Mapping[str, Mapping[str, Sequence[str]]], x: xr.DataArray) -> dict[str, Any]:
    """Give accuracies and their 95 % intervals, by mode and model."""
    found: dict[str, Any] = {"n": x.sizes["clip"]}
    for mode, title in TITLES.items():
        right = {
            model: int((np.array(labels[mode]) == x[mode].values).sum())
            for model, labels in named.items()
        }
        found[title] = {model: r / x.sizes["clip"] for model, r in right.items()}
        found[f"{title}_interval"] = {m: interval(r, x.sizes["clip"]) for m, r in right.items()}
    return found


def calibration(probabilities: xr.Dataset, x: xr.DataArray, mode: str) -> dict[str, Any]:
    """Compare the probability of the class named with how often it is right.

    Returns
    -------
    ``confidence``, ``right`` and ``n`` of equal bins of the probability, the expected
    calibration error, the mean probability of the class named and how often it is right, and
    the mean log probability of the true class.
    """
    p = probabilities[f"p_{mode}"]
    most = p.values.max(axis=1)
    right = np.array(best_levels(probabilities, mode)) == x[mode].values
    bins = np.minimum((most * BINS).astype(int), BINS - 1)
    rows = [(most[bins == b].mean(), right[bins == b].mean(), int((bins == b).sum()))
            for b in range(BINS) if (bins == b).any()]  # fmt: skip
    error = sum(abs(c - r) * n for c, r, n in rows) / len(most)
    names = p[mode].values.tolist()
    true = p.values[np.arange(len(right)), [names.index(v) for v in x[mode].values.tolist()]]
    return {
        "confidence": [float(c) for c, _, _ in rows],
        "right": [float(r) for _, r, _ in rows],
        "n": [n for _, _, n in rows],
        "expected_error": float(error),
        "mean_confidence": float(most.mean()),
        "mean_right": float(right.mean()),
        "log_score": float(np.log(np.maximum(true, 1e-300)).mean()),
    }
