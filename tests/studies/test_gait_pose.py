"""The gait-pose study: its arithmetic on small stand-ins, its tables."""

import numpy as np
import pytest

from bayesmotion.models.gait_pose.encoding import learn_cycle_encoding
from bayesmotion.motion.cycles import cycles_of, diversified
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.studies.gait_pose.contest import summary, swings
from bayesmotion.studies.gait_pose.learning import faster
from bayesmotion.studies.gait_pose.report import markdown
from bayesmotion.studies.gait_pose.walks import Walks


def test_mean_and_standard_error():
    assert summary([1.0, 2.0, 3.0]) == pytest.approx([2.0, np.sqrt(1.0 / 3.0)])
    assert summary([4.0]) == [4.0, 0.0]


def test_full_learning_is_timed_to_the_same_density_within_a_hundredth():
    trace = [[20.0, 1.0, 50.0], [40.0, 2.0, 99.5], [60.0, 3.0, 120.0]]
    found = faster([[2.0, 0.5, 100.0], [5.0, 1.0, 118.0], [9.0, 2.0, 200.0]], trace)
    assert found["full_over_local"] == {"2": 4.0, "5": 3.0, "9": None}
    assert (found["full_last"], found["full_seconds"]) == (120.0, 3.0)
    # 118 is not within a hundredth of 120, 200 is past it.
    assert found["full_over_local_to_last"] == 1.5
    assert faster([[2.0, 0.5, 100.0]], trace)["full_over_local_to_last"] is None


def test_tables_hold_what_the_results_do():
    row = {"torus3": [20.04, 1.5], "pca": [30.0, 2.0]}
    result = {
        "training_cycles": 20,
        "training_subjects": ["02", "05"],
        "training": {"torus3": {"seconds": 6.2, "log_density": 143101.4, "converged": None}},
        "interpolation": {"0.4": row, "stride": row},
        "swings": {"larm": {"strides": [3.0, 4.04], "training": [1.0, 1.9]}},
        "reconstruction": {"left arm": {"0.4": row}},
        "coverage90": {"left arm": {"0.4": {"torus3": 0.9}}},
        "filtering": {"0.1": {"0.4": {**row, "savgol": [5.0, 0.1]}}},
        "held_out": {
            "per_entry": {"torus": [1.0, 0.1], "none": [0.5, 0.1]},
            "against_none": {"torus": [0.5, 0.05]},
        },
        "learning": {
            "local": [[2.0, 0.5, 109.5]], "full": [[20.0, 9.0, 110.0]],
            "full_over_local": {"2": 18.0},
        },
        "step_milliseconds": {"1800": 1.0, "19980": 1.1},
    }  # fmt: skip
    text = markdown(result)
    assert "20 training cycles of 2 people" in text
    assert "| torus, three layers | 6 | 143,101 | after all sweeps |" in text
    assert "| torus, three layers | 20.0 ± 1.5 | 20.0 ± 1.5 |" in text
    assert "| left arm | torus, three layers | 90 % |" in text
    assert "| left arm | 3.00 | 4.04 | 1.90 |" in text
    assert "Savitzky-Golay | 5.0 ± 0.1" in text
    assert "| torus | 1.000 ± 0.100 | +0.500 ± 0.050 |" in text
    assert "| 2 | 0.5 | 110 | 18.0 |" in text
    assert "it takes 18.0 times as long as local learning" in text
    assert "1.10 ms with 19,980 points" in text


def test_a_limb_swings_as_far_as_it_is_scaled():
    walks = synthetic_walkers(("ann", "ben", "cas"), ("walk",), seconds=2.6, styles=2)
    cycles = cycles_of(walks, 1, poses=12)
    encoding = learn_cycle_encoding(cycles)
    y = encoding.scaled(cycles).reshape(3, 12, -1)
    longer = encoding.scaled(diversified(cycles, 1.5)).reshape(3, 12, -1)
    found = swings(Walks(cycles, {"stride": longer}, encoding))
    columns = encoding.columns(["lfemur", "ltibia", "lfoot"])
    swing = np.sqrt(y[:, :, columns].var(axis=1).sum(axis=1))
    expected = 1.5 * np.array([swing.mean(), swing.max()]) / np.median(swing)
    np.testing.assert_allclose(found["lleg"]["strides"], expected)
    assert found["lleg"]["training"][1] == pytest.approx(expected[1] / 1.5)
