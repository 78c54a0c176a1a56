"""Recognition: simulated truth, calibration, controls, and real segments."""

import numpy as np
import pytest
import xarray as xr
from bayesmotion.models.multifactor_tensor import MultifactorTensor
from bayesmotion.models.tensor_classes import NEW
from bayesmotion.tasks.recognise import (
    _exceeded_by,
    alien,
    best_levels,
    recognise,
    repetition_folds,
    thresholds,
    train,
)

from bayesmotion.errors import InputError

VALUES = {"log_odds": 0.0, "log_scale": 1.0, "log_dof": 2.3}
PEOPLE, TASKS, REPETITIONS, D = 4, 5, 3, 12


def simulated(seed: int, people: int = PEOPLE, noise: float = 0.6) -> xr.DataArray:
    """Draw segments from the model itself."""
    random = np.random.default_rng(seed)
    who, what, _ = np.indices((people, TASKS, REPETITIONS)).reshape(3, -1)
    effects = random.normal(size=(people, D)), 3 * random.normal(size=(TASKS, D))
    cell = 0.4 * random.normal(size=(people, TASKS, D))
    y = effects[0][who] + effects[1][what] + cell[who, what]
    y += noise * random.normal(size=y.shape)
    return xr.DataArray(
        y[:, :, None],
        dims=("clip", "channel", "coefficient"),
        coords={
            "clip": [f"c{i}" for i in range(len(y))],
            "subject": ("clip", [f"p{i}" for i in who]),
            "task": ("clip", [f"t{i}" for i in what]),
        },
    )


@pytest.fixture(scope="module")
def segments():
    return simulated(0)


@pytest.fixture(scope="module")
def trained(segments):
    held = repetition_folds(segments, ("subject", "task"))[-1]
    return train(MultifactorTensor(rank=12), segments[~held]), segments[~held], segments[held]


def test_probabilities_name_the_truth_and_are_calibrated(trained):
    recogniser, _, probes = trained
    found = recognise(recogniser, probes, aliens=False)
    assert recogniser.converged
    for mode, least in (("task", 0.95), ("subject", 0.8)):
        p = found[f"p_{mode}"]
        np.testing.assert_allclose(p.sum(mode), 1.0)
        right = np.array(best_levels(found, mode)) == probes[mode].values
        assert right.mean() >= least
        se = np.sqrt((p.max(mode) * (1 - p.max(mode))).sum()) / len(right)
        assert abs(float(p.max(mode).mean()) - right.mean()) < 4 * float(se) + 0.05


def test_shuffled_labels_are_no_better_than_chance(segments):
    held = repetition_folds(segments, ("subject", "task"))[-1]
    part = segments[~held]
    mixed = np.random.default_rng(1).permutation(part.sizes["clip"])
    wrong = part.assign_coords(subject=("clip", part["subject"].values[mixed]))
    found = recognise(
        train(MultifactorTensor(rank=12), wrong, values=VALUES), segments[held], aliens=False
    )
    right = np.array(best_levels(found, "subject")) == segments[held]["subject"].values
    assert right.mean() < 0.55


def test_a_task_never_seen_is_found_and_known_ones_are_not(segments):
    away = segments["task"].values == "t4"
    held = repetition_folds(segments, ("subject", "task"))[-1]
    recogniser = train(MultifactorTensor(rank=12), segments[~away & ~held], values=VALUES)
    limit = thresholds(recogniser, segments[~away & ~held])
    new = alien(recognise(recogniser, segments[away]), limit)["task"]
    known = alien(recognise(recogniser, segments[~away & held]), limit)["task"]
    assert new.mean() > 0.9
    assert known.mean() <= 0.2


def test_a_threshold_is_exceeded_by_the_share_that_was_asked_for(segments):
    """Cells count alike: adding repetitions of one cell is no licence for false alarms."""
    recogniser = train(MultifactorTensor(rank=12), segments, values=VALUES)
    limits = [thresholds(recogniser, segments, share)["task"] for share in (0.3, 0.1, 0.02)]
    assert limits[0] < limits[1] < limits[2]
    values, weight = np.array([5.0, 1.0, 3.0, 2.0]), np.array([1.0, 1.0, 1.0, 7.0])
    assert _exceeded_by(values, weight, 0.2) == 2.0
    assert _exceeded_by(values, weight, 0.15) == 3.0
    assert _exceeded_by(values, np.ones(4), 0.0) == 5.0


def test_a_cell_never_recorded_is_named(segments):
    away = (segments["subject"].values == "p1") & (segments["task"].values == "t2")
    recogniser = train(MultifactorTensor(rank=12), segments[~away], values=VALUES)
    found = recognise(recogniser, segments[away], aliens=False)
    assert best_levels(found, "task") == ["t2"] * REPETITIONS


def test_rank_and_values_change_something(segments, trained):
    recogniser, part, probes = trained
    other = train(MultifactorTensor(rank=3), part, values=VALUES)
    assert other.training.tensor.y.shape[1] == 3
    shifted = {**recogniser.values, "log_odds": 3.0}
    moved = train(MultifactorTensor(rank=12), part, values=shifted)
    assert not np.allclose(moved.log_density(probes), recogniser.log_density(probes))


def test_one_probe_takes_less_than_50_milliseconds(trained):
    import time

    recogniser, _, probes = trained
    recognise(recogniser, probes[:1])
    began = time.process_time()
    for row in range(10):
        recognise(recogniser, probes[row : row + 1])
    assert (time.process_time() - began) / 10 < 0.05


def test_folds_leave_out_every_repetition_but_no_lonely_one():
    x = simulated(2)[:-2]
    folds = repetition_folds(x, ("subject", "task"))
    assert len(folds) == REPETITIONS
    assert not np.any(folds, axis=0)[-1]
    assert (np.sum(folds, axis=0)[:-1] == 1).all()


def test_bad_input_is_told(segments):
    unknown = segments.assign_coords(task=("clip", [""] * segments.sizes["clip"]))
    with pytest.raises(InputError, match="unknown for some clip"):
        train(MultifactorTensor(), unknown)
    with pytest.raises(InputError, match="missing entries"):
        train(MultifactorTensor(), segments.where(segments < 2))
    first = repetition_folds(segments, ("subject", "task"))[0]
    lonely = segments[first]
    with pytest.raises(InputError, match="single repetition"):
        thresholds(train(MultifactorTensor(rank=5), lonely, values=VALUES), lonely)


def test_the_new_level_has_a_name(trained):
    recogniser, _, probes = trained
    assert recognise(recogniser, probes)["task"].values[-1] == NEW
