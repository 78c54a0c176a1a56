"""The board in millimetres: joints, forecasts of windows, and a process against its formula."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bayesmotion.studies.cmu_mm.data import FRAMES, Body, Windows, errors_mm, windows_of
from bayesmotion.studies.cmu_mm.methods import Process, nearest, process, ridge, zero
from bayesmotion.studies.cmu_mm.study import best_process, block_interval, scored

BODY = Body(
    np.array([-1, 0, 1, 1]),
    np.array([[0.0, 0, 0], [0, 100, 0], [0, 50, 0], [0, 50, 0]]),
    np.arange(3, 15).reshape(4, 3),
    np.array([1, 2]),
    np.array([3]),
    np.array([2]),
)


def swinging(frames, period, seed):
    random, values = np.random.default_rng(seed), np.zeros((frames, 15))
    theta = random.uniform(0, 6) + 2 * np.pi * np.arange(frames) / period
    values[:, 3], values[:, 8] = 0.5 * np.cos(theta), 0.8 * np.sin(theta)
    return values + 0.002 * random.normal(size=values.shape) * (np.arange(15) > 2)


@pytest.fixture(scope="module")
def files():
    return [windows_of(BODY, swinging(90, 20 + i, i)) for i in range(3)]


@pytest.fixture(scope="module")
def test():
    return windows_of(BODY, swinging(80, 21, 9))


def test_joints_lie_where_rotations_of_row_vectors_put_them():
    values = swinging(5, 20, 0)
    made = BODY.positions_mm(values)
    for frame in range(5):
        vectors = values[frame, BODY.columns[:2]]
        first, second = Rotation.from_rotvec(vectors).as_matrix()
        np.testing.assert_allclose(made[frame, 1], [0, 100, 0] @ first)
        np.testing.assert_allclose(made[frame, 2], made[frame, 1] + [0, 50, 0] @ second @ first)


def test_errors_are_those_of_all_joints_at_their_frames(test):
    off = test.future.copy()
    off[:, :, 3] += 4.0  # x of the second predicted joint, and of the one that lies there
    errors = errors_mm(BODY, test, off)
    assert errors.shape == (len(test.context), len(FRAMES))
    np.testing.assert_allclose(errors, 2 * 4.0 / 4)
    np.testing.assert_allclose(errors_mm(BODY, test, test.future), 0.0, atol=1e-9)


def test_a_process_is_its_formula(files):
    train, few = files[0].every(9), files[1].every(20)
    settings = Process(0.5, 1.5, 0.02, 0.3)

    def inputs(context):
        last = context[:, -1]
        way = (context[:, :-1] - last[:, None]).reshape(len(context), -1)
        return np.concatenate([way, 0.5 * (last - train.context[:, -1].mean(axis=0))], axis=1)

    known, here = inputs(train.context), inputs(few.context)
    size = np.sqrt(np.mean(np.sum(known**2, axis=1)))

    def k(one, other):
        away = np.sum((one - other) ** 2) / size**2
        return 1 / (1 + away / (2 * 1.5**2)) + 0.3 * one @ other / size**2

    K = np.array([[k(a, b) for b in known] for a in known]) + 0.02 * np.eye(len(known))
    target = (train.future - train.context[:, -1:])[:, 6, 2]
    told = process(train, few.context, settings)
    for row, u in enumerate(here):
        cross = np.array([k(u, b) for b in known])
        mean = few.context[row, -1, 2] + cross @ np.linalg.solve(K, target)
        scale = np.mean(target * np.linalg.solve(K, target))
        variance = scale * (k(u, u) - cross @ np.linalg.solve(K, cross) + 0.02) + 0.1**2
        assert told.mean[row, 6, 2] == pytest.approx(mean)
        assert told.sd is not None
        assert told.sd[row, 6, 2] == pytest.approx(np.sqrt(variance))


def test_methods_that_learn_err_less_and_know_how_much(files, test):
    train = Windows(*(np.concatenate([getattr(f, n) for f in files])
                      for n in ("context", "future", "whole")))  # fmt: skip
    chosen = best_process(BODY, [one.every(3) for one in files])
    settings, scale = Process(*chosen["settings"]), np.array(chosen["error_scale"])
    methods = {
        "zero": zero,
        "nearest": nearest,
        "ridge": lambda t, c: ridge(t, c, 1e3),
        "process": lambda t, c: process(t, c, settings, scale),
    }
    found = {name: scored(BODY, train, test, method, 0) for name, method in methods.items()}
    for name in ("nearest", "ridge", "process"):
        assert found[name]["400"]["error_mm"] < 0.5 * found["zero"]["400"]["error_mm"]
    assert found["process"]["80"]["coverage90"] > 0.7
    assert "crps" not in found["zero"]["80"]


def test_an_interval_of_blocks_is_wider_than_of_windows_that_are_alike():
    errors = np.repeat(np.random.default_rng(0).normal(size=20), 35)
    low, high = block_interval(errors, 0)
    assert high - low == pytest.approx(2 * 1.96 * errors[::35].std() / np.sqrt(20), rel=0.2)
