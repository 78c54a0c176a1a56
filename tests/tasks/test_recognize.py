"""Recognition: simulated truth, calibration, controls, small sets, and all draws."""

import numpy as np
import pytest
import xarray as xr

import bayesmotion as bm
from bayesmotion.errors import InputError
from bayesmotion.fit import Fit
from bayesmotion.models.motion_tensor import MotionTensor
from bayesmotion.motion.segments import Segmenting
from bayesmotion.studies.keypose.models import train
from bayesmotion.studies.keypose.novelty import _exceeded_by, novel, thresholds
from bayesmotion.tasks.recognize import (
    NEW,
    best_levels,
    calibrated,
    class_probabilities,
    recognize,
    recognizer_of,
    repetition_folds,
)

SITES = {"log_odds": 0.0, "log_scale": 1.0, "log_dof": 2.3}
VALUES = {name: np.array([value]) for name, value in SITES.items()}
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
    return train(segments[~held], 12), segments[~held], segments[held]


def test_probabilities_name_the_truth_and_are_calibrated(trained):
    recognizer, _, probes = trained
    found = class_probabilities(recognizer, probes, novelty=False)
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
    found = class_probabilities(train(wrong, 12, VALUES), segments[held], novelty=False)
    right = np.array(best_levels(found, "subject")) == segments[held]["subject"].values
    assert right.mean() < 0.55


def test_a_task_never_seen_is_found_and_known_ones_are_not(segments):
    away = segments["task"].values == "t4"
    held = repetition_folds(segments, ("subject", "task"))[-1]
    recognizer = train(segments[~away & ~held], 12, VALUES)
    limit = thresholds(recognizer, segments[~away & ~held])
    new = novel(class_probabilities(recognizer, segments[away]), limit)["task"]
    known = novel(class_probabilities(recognizer, segments[~away & held]), limit)["task"]
    assert new.mean() > 0.9
    assert known.mean() <= 0.2


def test_a_threshold_is_exceeded_by_the_share_that_was_asked_for(segments):
    """Cells count alike: adding repetitions of one cell is no licence for false alarms."""
    recognizer = train(segments, 12, VALUES)
    limits = [thresholds(recognizer, segments, share)["task"] for share in (0.3, 0.1, 0.02)]
    assert limits[0] < limits[1] < limits[2]
    values, weight = np.array([5.0, 1.0, 3.0, 2.0]), np.array([1.0, 1.0, 1.0, 7.0])
    assert _exceeded_by(values, weight, 0.2) == 2.0
    assert _exceeded_by(values, weight, 0.15) == 3.0
    assert _exceeded_by(values, np.ones(4), 0.0) == 5.0


def test_a_cell_never_recorded_is_named(segments):
    away = (segments["subject"].values == "p1") & (segments["task"].values == "t2")
    recognizer = train(segments[~away], 12, VALUES)
    found = class_probabilities(recognizer, segments[away], novelty=False)
    assert best_levels(found, "task") == ["t2"] * REPETITIONS


def test_rank_and_values_change_something(segments, trained):
    recognizer, part, probes = trained
    other = train(part, 3, VALUES)
    assert other.training.tensor.y.shape[1] == 3
    shifted = {**recognizer.values, "log_odds": np.array([3.0])}
    moved = train(part, 12, shifted)
    assert not np.allclose(moved.log_density(probes), recognizer.log_density(probes))


def test_one_probe_takes_less_than_50_milliseconds(trained):
    import time

    recognizer, _, probes = trained
    class_probabilities(recognizer, probes[:1])
    began = time.process_time()
    for row in range(10):
        class_probabilities(recognizer, probes[row : row + 1])
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
        train(unknown)
    first = repetition_folds(segments, ("subject", "task"))[0]
    lonely = segments[first]
    with pytest.raises(InputError, match="single repetition"):
        thresholds(train(lonely, 5, VALUES), lonely)


def test_the_new_level_has_a_name(trained):
    recognizer, _, probes = trained
    assert class_probabilities(recognizer, probes)["task"].values[-1] == NEW


def test_calibrated_probabilities_add_up_and_move_with_what_is_expected(trained):
    recognizer, _, probes = trained
    few, half = calibrated(recognizer, probes, 0.05), calibrated(recognizer, probes)
    for mode in ("subject", "task"):
        np.testing.assert_allclose(half[f"p_{mode}"].sum(mode), 1.0)
        new = [found[f"p_{mode}"].sel({mode: NEW}).values for found in (few, half)]
        assert (new[0] < new[1]).all()
        right = np.array(best_levels(half, mode)) == probes[mode].values
        assert right.mean() >= 0.8
    with pytest.raises(InputError, match="no probability"):
        calibrated(recognizer, probes, 1.0)


PEOPLE3, TASKS4 = ("ann", "ben", "cat"), ("bow", "wave", "kick", "jump")


@pytest.fixture(scope="module")
def small_set(acted):
    """Three people, four tasks, two repetitions; a third one, another person, another task."""
    return acted((*PEOPLE3, "dan"), (*TASKS4, "sit"), 3)


@pytest.fixture(scope="module")
def small_fit(small_set):
    labels = small_set["clip"].str
    known = small_set["subject"].isin(PEOPLE3) & small_set["task"].isin(TASKS4)
    return bm.fit(
        MotionTensor(segmenting=Segmenting("positions", 2)),
        small_set.isel(frame=(known & ~labels.endswith("2")).values),
        method=bm.MAP(initial=1, keep=1),
    )


def part(clips, who, what, repetition):
    keep = clips["subject"].isin(who) & clips["task"].isin(what)
    return clips.isel(frame=(keep & clips["clip"].str.endswith(repetition)).values)


def test_of_a_small_set_nothing_is_named_for_certain(small_set, small_fit):
    """Three people left out tell no more than that the next one is noticed 4 times in 5."""
    known = recognize(small_fit, part(small_set, PEOPLE3, TASKS4, "2"))
    person = recognize(small_fit, part(small_set, ("dan",), TASKS4, "2"))
    task = recognize(small_fit, part(small_set, PEOPLE3, ("sit",), "2"))
    for mode, found in (("subject", person), ("task", task)):
        p = found[f"p_{mode}"]
        assert (p.sel({mode: NEW}) > 0.1).all()
        assert float(p[:, :-1].max()) < 0.9
        # What is new looks newer than what is known.
        assert float(p.sel({mode: NEW}).mean()) > float(known[f"p_{mode}"].sel({mode: NEW}).mean())
    for mode in ("subject", "task"):
        p = known[f"p_{mode}"]
        assert float(p.sel({mode: NEW}).min()) > 0.01
        true = [c.split("-")[("subject", "task").index(mode)] for c in known["clip"].values]
        assert np.mean(np.array(best_levels(known, mode)) == true) > 0.8


@pytest.mark.thorough
def test_all_draws_are_averaged_whatever_their_order(small_set, small_fit):
    posterior = small_fit.tree["posterior"].to_dataset()
    away = xr.DataArray([0.0, 0.5, -0.3, 1.0], dims="draw")
    several = (posterior.isel(draw=0, drop=True) + away).transpose("chain", "draw")

    def fit_of(draws):
        tree = small_fit.tree.copy()
        tree["posterior"] = xr.DataTree(draws.assign_coords(draw=range(draws.sizes["draw"])))
        return Fit(small_fit.model, small_fit.motion, tree)

    probes = part(small_set, PEOPLE3, TASKS4[:2], "2")
    one = recognize(fit_of(several), probes)
    other = recognize(fit_of(several.isel(draw=slice(None, None, -1))), probes)
    xr.testing.assert_allclose(one, other, rtol=1e-9)
    first = recognize(fit_of(several.isel(draw=[0])), probes)
    assert float(abs(first["p_subject"] - one["p_subject"]).max()) > 1e-4
    new = recognizer_of(fit_of(several))
    segments = small_fit.training.segments[:3]
    each = [recognizer_of(fit_of(several.isel(draw=[d]))).log_density(segments) for d in range(4)]
    np.testing.assert_allclose(
        new.log_density(segments), np.log(np.mean(np.exp(np.array(each) - np.max(each)), axis=0))
        + np.max(each), atol=1e-8,
    )  # fmt: skip


def test_missing_limbs_and_fits_of_other_models(small_set, small_fit):
    probes = part(small_set, PEOPLE3, TASKS4, "2").copy(deep=True)
    arm = [d for d in probes["dof"].values.tolist() if d.startswith(("rhumerus", "rradius"))]
    probes["angle"].loc[{"dof": arm}] = np.nan
    found = recognize(small_fit, probes)
    true = [c.split("-")[1] for c in found["clip"].values]
    assert np.mean(np.array(best_levels(found, "task")) == true) > 0.8
    other = Fit(bm.example("keyposes")[0], small_fit.motion, small_fit.tree)
    with pytest.raises(
        InputError, match=r"not tell who moves and what they do\. Fit motion_tensor\."
    ):
        recognize(other, probes)
