"""Where the search begins: phases and steps are found in motion whose truth is known."""

import numpy as np
import pytest

from bayesmotion.distributions.dynamics import path_scale
from bayesmotion.models.multifactor import Circle, GPDynamics, Multifactor, White
from bayesmotion.models.multifactor.data import prepare
from bayesmotion.models.multifactor.initial_values import (
    CYCLES_PER_SECOND,
    cycle,
    phases,
    preconditioners,
    training_values,
)
from bayesmotion.motion.synthetic.walkers import synthetic_truth, synthetic_walkers

SETTINGS = {"subjects": ["ann", "ben"], "gaits": ["walk", "run"], "seconds": 2.5, "seed": 3}


def turn(angle):
    """Bring an angle to within half a turn of zero."""
    return np.angle(np.exp(1j * np.asarray(angle)))


@pytest.fixture(scope="module")
def training():
    return prepare(synthetic_walkers(**SETTINGS), ("subject", "gait"))


@pytest.fixture(scope="module")
def truth():
    return synthetic_truth(**SETTINGS)


@pytest.mark.parametrize("step", [0.15, 0.23, 0.4])
def test_the_step_of_harmonics_in_noise_is_found(step: float):
    random = np.random.default_rng(0)
    n, d = 90, 8
    time = np.arange(n) - (n - 1) / 2
    amplitude = random.normal(size=(3, d)) * np.array([1.0, 0.4, 0.2])[:, None]
    shift = random.uniform(0, 2 * np.pi, (3, d))
    waves = [
        a * np.cos((k + 1) * step * time[:, None] + s)
        for k, (a, s) in enumerate(zip(amplitude, shift, strict=True))
    ]
    y = sum(waves) + 5.0 + 0.1 * random.normal(size=(n, d))
    found, harmonic = cycle(y, 30.0)
    assert found == pytest.approx(step, abs=0.006)
    clear = np.abs(amplitude[0]) > 0.5
    lag = np.angle(harmonic) - shift[0] - np.pi * (amplitude[0] < 0)
    assert np.abs(turn(lag[clear])).max() < 0.2


def test_the_step_stays_where_a_gait_can_be():
    time = np.arange(120)[:, None]
    low, high = (2 * np.pi * f / 30.0 for f in CYCLES_PER_SECOND)
    for step in (0.01, 1.5):
        found, _ = cycle(np.cos(step * time), 30.0)
        assert low - 1e-9 <= found <= high + 1e-9


def test_phases_and_steps_of_walkers_are_found_up_to_a_common_shift(training, truth):
    middle, step = phases(training.frames)
    assert middle.shape == step.shape == (4,)
    lag = []
    for clip, phase, stepped in zip(training.clips, middle, step, strict=True):
        true = truth.phase.values[truth.phase["clip"].values == clip]
        assert stepped == pytest.approx(np.diff(true).mean(), rel=0.1)
        lag.append(phase - 0.5 * (true[(len(true) - 1) // 2] + true[len(true) // 2]))
    common = np.angle(np.mean(np.exp(1j * np.array(lag))))
    assert np.abs(turn(np.array(lag) - common)).max() < 0.3


@pytest.mark.parametrize("content", [Circle(), GPDynamics()], ids=["circle", "gp"])
def test_initial_values_have_every_site_and_differ(training, content):
    model = Multifactor(content, residual=White())
    starts = training_values(model, training.frames, 5, 2)
    wanted = {"gamma", "beta", "scale", "shape_subject", "shape_gait"}
    wanted |= {"phase_point", "step"} if model.on_circle else {"alpha", "x"}
    assert len(starts) == 2
    for start in starts:
        assert set(start) == wanted
        assert all(np.isfinite(value).all() for value in start.values())
    assert not np.array_equal(starts[0]["shape_gait"], starts[1]["shape_gait"])


def test_the_seed_decides_the_random_part(training):
    model = Multifactor(residual=White())
    one, same, other = (training_values(model, training.frames, k, 1)[0] for k in (5, 5, 6))
    for name, value in one.items():
        np.testing.assert_array_equal(value, same[name])
    assert not np.array_equal(one["shape_gait"], other["shape_gait"])


def test_the_circle_s_fit_is_where_paths_begin(training):
    """The first start has the circle's kernel, but for its small further column."""
    on_circle = {
        **training_values(Multifactor(), training.frames, 0, 1)[0],
        "phase": np.array([0.1, 0.9, 2.0, -1.0]),
        "step": np.array([0.15, 0.2, 0.25, 0.3]),
        "gamma": np.array(1.7),
    }
    model = Multifactor(GPDynamics())
    first, second = training_values(model, training.frames, 0, 2, on_circle)
    np.testing.assert_allclose(path_scale(first["x"], training.frames.steps), 1.0)
    clip, time = np.asarray(training.frames.clip), np.asarray(training.frames.time)
    angle = on_circle["phase"][clip] + on_circle["step"][clip] * time
    apart = np.abs(np.exp(1j * angle)[:, None] - np.exp(1j * angle)[None]) ** 2
    plane = first["x"][:, :2]
    square = np.sum((plane[:, None] - plane[None]) ** 2, axis=-1)
    np.testing.assert_allclose(first["gamma"] * square, 1.7 * apart, atol=1e-9)
    assert 0.0 < np.std(first["x"][:, 2]) < 0.15 * np.std(first["x"][:, 0])
    for start in (first, second):
        for name in ("shape_subject", "shape_gait", "scale", "beta"):
            np.testing.assert_array_equal(start[name], on_circle[name])
    # Other starts have other content: the principal components.
    assert np.abs(first["x"] - second["x"]).max() > 0.5


def test_paths_alone_have_a_preconditioner(training):
    model = Multifactor(GPDynamics(balanced=True))
    start = training_values(model, training.frames, 0, 1)[0]
    n = len(training.frames.clip)
    assert preconditioners(model, training.frames, start)["x"].shape == (n, n)
    circle = Multifactor()
    begin = training_values(circle, training.frames, 0, 1)[0]
    assert preconditioners(circle, training.frames, begin) == {}
