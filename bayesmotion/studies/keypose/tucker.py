"""Missing cells of the tensor position x person x task, predicted by its other cells.

Every cell of HDM05 is left out once (one of every task at a time) and predicted by the
Bayesian Tucker model with its core integrated out, by the same without shared columns, and by
the additive person-plus-task mean. A cell is the mean of its repetitions, in coordinates of
the position mode of the cells that are there.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from ...inference.density import ProgramDensity
from ...inference.optimisation.optimise import maximise
from ...intervals import NINETY
from ...models.motion_tensor.data import position_mode, vectors
from .tucker_model import CollapsedTucker, additive, cells_of

SHARED = (2, 4)
COORDINATES = 40
STEPS = 300
MODELS = ("tucker", "tucker_without_sharing", "additive")
RESAMPLES = 2000


@dataclass(frozen=True)
class Predicted:
    """Predictions of cells that were left out.

    cells
        For every model (person, task, D).
    covered
        Share of the left out entries, in coordinates, within the 90 % interval of the Tucker
        model; the spread of repetitions about a cell's mean is not in it.
    converged
        Whether both searches did.
    """

    cells: dict[str, Float[np.ndarray, "p t d"]]
    covered: float
    converged: bool


def tucker_plan() -> dict[str, Any]:
    """The settings of this part of the study."""
    return {
        "shared": list(SHARED),
        "coordinates": COORDINATES,
        "steps": STEPS,
        "resamples": RESAMPLES,
    }


def cell_means(x: xr.DataArray) -> Float[np.ndarray, "p t d"]:
    """Give the mean vector of every cell's repetitions."""
    people, who = np.unique(x["subject"].values, return_inverse=True)
    tasks, what = np.unique(x["task"].values, return_inverse=True)
    rows = vectors(x)
    return np.stack(
        [
            [rows[(who == i) & (what == j)].mean(axis=0) for j in range(len(tasks))]
            for i in range(len(people))
        ]
    )


def run(x: xr.DataArray, seed: int) -> dict[str, Any]:
    """Give errors of missing cells: root mean square over all entries of the vectors.

    Parameters
    ----------
    x
        Segments with the labels subject and task.
    seed
        Of the starts and the resampling.
    """
    means = cell_means(x)
    people, tasks, _ = means.shape
    errors: dict[str, list[float]] = {name: [] for name in MODELS}
    converged, covered = [], []
    for away in range(people):
        seen = np.ones((people, tasks), dtype=bool)
        seen[(away + np.arange(tasks)) % people, np.arange(tasks)] = False
        found = predict(means, seen, seed)
        converged.append(found.converged)
        covered.append(found.covered)
        for name, tensor in found.cells.items():
            errors[name] += np.sqrt(np.square(tensor - means)[~seen].mean(axis=1)).tolist()
    gain = np.array(errors["additive"]) - np.array(errors["tucker"])
    return {
        "error": {name: float(np.mean(values)) for name, values in errors.items()},
        "gain": float(gain.mean()),
        "gain_interval": bootstrapped(gain, seed),
        "tucker_better_in": int((gain > 0).sum()),
        "n": len(gain),
        "coverage90": float(np.mean(covered)),
        "shared_columns": list(SHARED),
        "converged": converged,
    }


def predict(
    means: Float[np.ndarray, "p t d"], seen: Bool[np.ndarray, "p t"], seed: int
) -> Predicted:
    """Predict all cells from those that are seen."""
    position = position_mode(means[seen], COORDINATES)
    tensor = np.full((position.basis.shape[1], *seen.shape), np.nan)
    tensor[:, seen] = position.coordinates(means[seen]).T
    spread = np.nanstd(tensor, axis=(1, 2), keepdims=True)
    cells = cells_of(tensor / spread, np.zeros(len(tensor), dtype=int))
    out, good, covered = {"additive": additive(tensor)}, [], 0.0
    for name, ranks in (("tucker", SHARED), ("tucker_without_sharing", (0, 0))):
        model = CollapsedTucker(ranks)
        found = maximise(
            ProgramDensity(model), model.initial_values(cells, seed, 1 + any(ranks)), (cells,),
            max_steps=STEPS,
        )  # fmt: skip
        best = found.best()
        mean, sd = model.predict(cells, best)
        out[name] = mean * spread
        good.append(bool(found.converged[0]))
        if name == "tucker":
            true = position.coordinates(means[~seen]).T / spread[:, 0]
            total = np.sqrt(np.square(sd[:, ~seen]) + np.exp(2.0 * best["log_noise"][0]))
            covered = float(np.mean(np.abs(true - mean[:, ~seen]) < NINETY * total))
    shape = (*seen.shape, means.shape[2])
    back = {k: position.vectors(v.reshape(len(v), -1).T).reshape(shape) for k, v in out.items()}
    return Predicted(back, covered, all(good))


def bootstrapped(values: Float[np.ndarray, " n"], seed: int) -> list[float]:
    """Give a 95 % interval of the mean by resampling."""
    random = np.random.default_rng(seed)
    means = random.choice(values, (RESAMPLES, len(values))).mean(axis=1)
    return [float(edge) for edge in np.quantile(means, (0.025, 0.975))]
