"""Who moves and what they do: posterior class probabilities of motion segments.

`train` fits the multifactor tensor to segments with known labels. `recognise` gives for
every probe the posterior over all combinations of levels, one of each mode's levels being
"never seen before"; all levels of a mode are as probable beforehand. A probe is called
alien in a mode when the log odds of the new level exceed the mode's threshold (odds and not
probabilities, which are 0 or 1 within rounding where vectors are long). `thresholds` chooses
it on the training segments alone: each cell's repetitions are left out in turn (in `FOLDS`
parts), and the threshold is the quantile that at most the wanted share of them exceeds.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from scipy.special import logsumexp

from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import require_finite
from ..inference.density import ProgramDensity
from ..inference.optimise import maximise
from ..models.multifactor_tensor import SITES, MultifactorTensor
from ..models.segment_training import SegmentTraining, segment_training, vectors
from ..models.tensor_classes import NEW, Classes, classes, log_density
from ..motion.segments import Segmenting, body_of
from ..motion.segments import segments as segments_of

FOLDS = 4


@dataclass(frozen=True)
class Recogniser:
    """A trained tensor.

    model
        The model with its settings.
    training
        The training segments as the program saw them.
    values
        Values of the sites.
    converged
        Whether the search for them converged.
    """

    model: MultifactorTensor
    training: SegmentTraining
    values: dict[str, float]
    converged: bool

    @property
    def levels(self) -> dict[str, list[str]]:
        """For each mode the names of the known levels."""
        return self.training.levels

    @cached_property
    def classes(self) -> Classes:
        """The densities of all combinations of levels."""
        training = self.training
        return classes(training.tensor, training.level, training.counts, **self.values)

    def log_density(self, probes: xr.DataArray) -> Float[np.ndarray, "n ..."]:
        """Log density of probes for each level of each mode; the last level is the new one."""
        flat = log_density(self.classes, self.training.position.coordinates(vectors(probes)))
        return flat.reshape(len(flat), *(count + 1 for count in self.training.counts))


def train(
    model: MultifactorTensor,
    segments: xr.DataArray,
    *,
    values: Mapping[str, float] | None = None,
    max_steps: int = 200,
) -> Recogniser:
    """Fit the tensor to segments with known labels.

    Parameters
    ----------
    model
        The model with its settings.
    segments
        As `bayesmotion.motion.segments.segments` gives them, with the model's modes as labels.
    values
        Values of the sites to keep; by default their posterior mode is searched.
    max_steps
        At most so many L-BFGS steps of the search.

    Raises
    ------
    InputError
        If a label is unknown, or there are too few segments.
    NumericalError
        If the log density is not finite.
    """
    training = segment_training(segments, model.modes, model.rank)
    if values is not None:
        return Recogniser(model, training, dict(values), True)
    starts = {name: np.array([value]) for name, value in model.initial().items()}
    found = maximise(ProgramDensity(model), starts, training.data, max_steps=max_steps)
    require_finite(found.log_density[0], "y")
    best = {name: float(found.best()[name]) for name in SITES}
    return Recogniser(model, training, best, bool(found.converged[0]))


def of_fit(fit: Fit) -> Recogniser:
    """Give the recogniser of a fit of the tensor, by its first draw.

    Raises
    ------
    InputError
        If the fit is of another model.
    """
    if not isinstance(fit.model, MultifactorTensor):
        raise InputError(
            f"a fit of {fit.model.name}",
            "it does not tell who moves and what they do",
            "Fit the model tensor, or the style models by their own tasks",
        )
    values = {name: float(value) for name, value in fit.values().items()}
    return Recogniser(fit.model, fit.training, values, bool(fit.stats().get("converged", True)))


def probes_of(fit: Fit, motion: xr.Dataset) -> xr.DataArray:
    """Describe clips as the training clips of a fit of the tensor were described.

    Raises
    ------
    InputError
        If their skeleton has other joints.
    """
    settings = json.loads(str(fit.tree.attrs["preparation"]))
    return segments_of(motion, Segmenting(**settings), body_of(fit.motion))


def recognise(recogniser: Recogniser, probes: xr.DataArray, *, aliens: bool = True) -> xr.Dataset:
    """Give posterior class probabilities of probes.

    Parameters
    ----------
    recogniser
        From `train`.
    probes
        Segments described as the training segments were.
    aliens
        Whether levels never seen are among the candidates.

    Returns
    -------
    For each mode a variable ``p_<mode>`` (clip, mode) of probabilities; with `aliens` the last
    level is called ``(new)``, and ``log_odds_<mode>`` (clip) are the log odds for it.
    """
    density = recogniser.log_density(probes)
    names = {mode: list(known) for mode, known in recogniser.levels.items()}
    if aliens:
        names = {mode: [*known, NEW] for mode, known in names.items()}
    else:
        density = density[(slice(None), *(slice(-1) for _ in names))]
    found: dict[str, tuple] = {}
    for axis, mode in enumerate(names, start=1):
        others = tuple(i for i in range(1, density.ndim) if i != axis)
        log_p = np.asarray(logsumexp(density, axis=others))
        p = np.exp(log_p - np.asarray(logsumexp(log_p, axis=1, keepdims=True)))
        found[f"p_{mode}"] = (("clip", mode), p)
        if aliens:
            known = np.asarray(logsumexp(log_p[:, :-1], axis=1))
            found[f"log_odds_{mode}"] = (("clip",), log_p[:, -1] - known)
    return xr.Dataset(found, coords={"clip": probes["clip"].values, **names})


def best_levels(probabilities: xr.Dataset, mode: str) -> list[str]:
    """Give the most probable known level of a mode for every probe."""
    p = probabilities[f"p_{mode}"]
    known = p.sel({mode: [name for name in p[mode].values.tolist() if name != NEW]})
    return known[mode].values[known.values.argmax(axis=1)].tolist()


def alien(
    probabilities: xr.Dataset, thresholds: Mapping[str, float]
) -> dict[str, Bool[np.ndarray, " n"]]:
    """Tell for each mode which probes are of a level never seen: log odds above a threshold."""
    return {
        mode: probabilities[f"log_odds_{mode}"].values > threshold
        for mode, threshold in thresholds.items()
    }


def repetition_folds(
    segments: xr.DataArray, modes: Sequence[str], most: int | None = None
) -> list[Bool[np.ndarray, " n"]]:
    """Give masks that leave out the first, second, ... repetition of every cell in turn.

    A cell's only repetition is never left out. With `most` (at least 2) there are so many
    masks at most: later repetitions of a cell go with earlier ones.
    """
    cells = list(zip(*(segments[mode].values.tolist() for mode in modes), strict=True))
    seen: dict[tuple, int] = {}
    order = np.zeros(len(cells), dtype=int)
    for row, cell in enumerate(cells):
        order[row] = seen[cell] = seen.get(cell, -1) + 1
    several = np.array([seen[cell] > 0 for cell in cells])
    order = order if most is None else order % most
    return (
        [several & (order == k) for k in range(order[several].max() + 1)] if several.any() else []
    )


def thresholds(
    recogniser: Recogniser, segments: xr.DataArray, false_alarms: float = 0.05
) -> dict[str, float]:
    """Choose from the training segments alone the log odds at which a level is called new.

    Parameters
    ----------
    recogniser
        Trained on `segments`; its site values are kept.
    segments
        The training segments.
    false_alarms
        Share of known segments that may be called new, every cell counting alike.

    Raises
    ------
    InputError
        If every cell has a single repetition.
    """
    folds = repetition_folds(segments, recogniser.model.modes, FOLDS)
    if not folds:
        raise InputError(
            "thresholds",
            "every combination of levels has a single repetition",
            "Give several repetitions of some, or a threshold",
        )
    new: dict[str, list[np.ndarray]] = {mode: [] for mode in recogniser.levels}
    cells: list[tuple] = []
    for held in folds:
        part = train(recogniser.model, segments[~held], values=recogniser.values)
        found = recognise(part, segments[held])
        labels = (segments[held][mode].values.tolist() for mode in recogniser.levels)
        cells += zip(*labels, strict=True)
        for mode, scores in new.items():
            scores.append(found[f"log_odds_{mode}"].values)
    # Every cell counts alike: one with many repetitions is known better than the others.
    counts = Counter(cells)
    weight = np.array([1.0 / counts[cell] for cell in cells])
    return {
        mode: _exceeded_by(np.concatenate(scores), weight, false_alarms)
        for mode, scores in new.items()
    }


def _exceeded_by(
    values: Float[np.ndarray, " n"], weight: Float[np.ndarray, " n"], share: float
) -> float:
    """Give the smallest of the values that at most a share of the weight exceeds."""
    order = np.argsort(values)[::-1]
    above = np.cumsum(weight[order]) - weight[order]
    return float(values[order][above <= share * weight.sum()][-1])
