"""The four models that recognition is measured with, on the same vectors.

tensor_paper     the paper's tensor and rule (`keypose_hosvd`)
tensor_bayes     the motion tensor at its mode (`bayesmotion.models.motion_tensor`)
nearest          the labels of the nearest training segment
discriminant     linear discriminant with a shrunk covariance (Ledoit and Wolf)
"""

import time
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Bool
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

from ...gp.linalg import AnyArray, require_finite
from ...inference.density import ProgramDensity
from ...inference.optimisation.optimise import maximise
from ...models.motion_tensor import MotionTensor
from ...models.motion_tensor.data import position_mode, tensor_training, vectors
from ...tasks.recognize import Recognizer, best_levels, class_probabilities
from .hosvd import PaperRule, paper_rule
from .scores import MODES, Named

MODELS = ("tensor_paper", "tensor_bayes", "nearest", "discriminant")

MAX_STEPS = 200

Mask = Bool[np.ndarray, " n"]


def train(
    x: xr.DataArray, rank: int | None = None, values: Mapping[str, AnyArray] | None = None
) -> Recognizer:
    """Fit the motion tensor to segments by its mode, or keep values of its sites (1,)."""
    model = MotionTensor(MODES, rank)
    training = tensor_training(x, model.modes, model.rank)
    if values is None:
        start = model.initial_values(training, 0, 1)[0]
        first = {name: np.asarray(value)[None] for name, value in start.items()}
        found = maximise(ProgramDensity(model), first, training.data, max_steps=MAX_STEPS)
        require_finite(found.log_density[0], "y")
        values = {name: jnp.asarray(value)[None] for name, value in found.best().items()}
    return Recognizer(model, training, values)


def nearest(x: xr.DataArray, trained: Mask, probes: Mask) -> dict[str, list[str]]:
    """Give the labels of the nearest training segment."""
    rows = vectors(x)
    gap = rows[probes][:, None] - rows[trained][None]
    best = np.square(gap).sum(axis=2).argmin(axis=1)
    return {mode: x[trained][mode].values[best].tolist() for mode in MODES}


def discriminant(
    x: xr.DataArray, trained: Mask, probes: Mask, rank: int | None
) -> dict[str, list[str]]:
    """Give the labels of a linear discriminant in the coordinates of the position mode."""
    rows = vectors(x)
    position = position_mode(rows[trained], rank)
    y = position.coordinates(rows)
    found = {}
    for mode in MODES:
        rule = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")
        rule.fit(y[trained], x[trained][mode].values)
        found[mode] = np.asarray(rule.predict(y[probes])).tolist()
    return found


def trained_rule(x: xr.DataArray, rank: int | None) -> tuple[PaperRule, list[list[str]]]:
    """Build the paper's tensor; give the rule and the names of the levels."""
    names = [sorted(set(x[mode].values.tolist())) for mode in MODES]
    level = np.stack(
        [
            [known.index(value) for value in x[mode].values.tolist()]
            for mode, known in zip(MODES, names, strict=True)
        ],
        axis=1,
    )
    joints, joint = np.unique(x["joint"].values, return_inverse=True)
    depth = [float(x["depth"].values[x["joint"].values == name][0]) for name in joints]
    every = np.repeat(joint, x.sizes["coefficient"])
    rows = vectors(x)
    kept = len(rows) if rank is None else rank
    return paper_rule(rows, level, every, np.array(depth), kept), names


def predictions(
    x: xr.DataArray, trained: Mask, probes: Mask, rank: int | None
) -> tuple[Named, xr.Dataset, dict[str, float]]:
    """Name persons and tasks of probes with every model.

    Returns
    -------
    ``{model: {mode: labels}}``, the Bayesian tensor's probabilities, milliseconds a probe.
    """
    named: Named = {}
    ms: dict[str, float] = {}
    rule, names = trained_rule(x[trained], rank)
    tensor = train(x[trained], rank)
    tensor.log_density(x[probes])  # compiled before the clock runs
    n = int(probes.sum())
    probabilities = xr.Dataset()
    for model in MODELS:
        began = time.perf_counter()
        if model == "tensor_paper":
            named[model] = {
                mode: [known[k] for k in rule.distances(vectors(x[probes]), m).argmin(axis=1)]
                for m, (mode, known) in enumerate(zip(MODES, names, strict=True))
            }
        elif model == "tensor_bayes":
            probabilities = class_probabilities(tensor, x[probes], novelty=False)
            named[model] = {mode: best_levels(probabilities, mode) for mode in MODES}
        elif model == "nearest":
            named[model] = nearest(x, trained, probes)
        else:
            named[model] = discriminant(x, trained, probes, rank)
        ms[model] = 1000.0 * (time.perf_counter() - began) / n
    return named, probabilities, ms


def one_probe_ms(x: xr.DataArray, trained: Mask, probes: Mask, count: int = 30) -> float:
    """Give the milliseconds the Bayesian tensor takes for one probe alone, novelty included."""
    tensor = train(x[trained])
    class_probabilities(tensor, x[probes][:1])
    began = time.perf_counter()
    for row in range(count):
        class_probabilities(tensor, x[probes][row : row + 1])
    return 1000.0 * (time.perf_counter() - began) / count


def first_repetitions(x: xr.DataArray) -> Mask:
    """Tell which segments are the first of their cell."""
    cells = list(zip(*(x[mode].values.tolist() for mode in MODES), strict=True))
    return np.array([cell not in cells[:row] for row, cell in enumerate(cells)])


def last_repetitions(x: xr.DataArray) -> Mask:
    """Tell which segments are the last of their cell."""
    return first_repetitions(x[::-1])[::-1]
