"""The optimiser against SciPy's, on functions whose optimum is known."""

import threading
import time
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from bayesmotion import programs
from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.inference.optimisation import optimise
from bayesmotion.inference.optimisation.optimise import Optimum, maximise


def rosenbrock(values, data):
    x = values["x"] - data
    return -jnp.sum(100.0 * (x[1:] - x[:-1] ** 2) ** 2 + (1.0 - x[:-1]) ** 2)


def badly_scaled(values, data):
    """A quadratic whose curvatures span six orders of magnitude, turned by an angle."""
    x, y = values["x"], values["y"]
    turned = jnp.array([0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y]) - data
    return -0.5 * jnp.sum(jnp.array([1e6, 1.0]) * turned**2)


def walled(values, data):
    """Log density of a gamma distribution: NaN at and below zero, steep close to it."""
    x = values["x"]
    return jnp.sum(jnp.where(x > 0, data * jnp.log(x) - x, jnp.nan))


def scipy_optimum(log_density, start, data):
    flat, unravel = jax.flatten_util.ravel_pytree(start)
    loss = jax.jit(jax.value_and_grad(lambda u: -log_density(unravel(u), data)))
    found = scipy.optimize.minimize(loss, flat, jac=True, method="L-BFGS-B", tol=1e-14)
    return -found.fun, found.x


@pytest.mark.parametrize("n", [2, 10])
def test_rosenbrock_reaches_scipys_optimum(n: int):
    random = np.random.default_rng(n)
    starts = {"x": np.concatenate([np.full((1, n), -1.2), random.normal(size=(3, n))])}
    optimum = maximise(rosenbrock, starts, jnp.asarray(0.5))
    assert optimum.converged.all()
    value, x = scipy_optimum(rosenbrock, {"x": starts["x"][1]}, 0.5)
    assert value == pytest.approx(0.0, abs=1e-8)
    assert optimum.log_density[0] == pytest.approx(0.0, abs=1e-7)
    np.testing.assert_allclose(optimum.best()["x"], x, atol=1e-3)
    np.testing.assert_allclose(optimum.best()["x"], 1.5, atol=1e-3)
    # Best first, and each value is that of its place.
    assert (np.diff(optimum.log_density) <= 0).all()
    for lane, value in enumerate(optimum.log_density):
        np.testing.assert_allclose(
            rosenbrock({"x": optimum.values["x"][lane]}, 0.5), value, rtol=1e-9, atol=1e-15
        )


def test_badly_scaled_quadratic():
    starts = {"x": np.array([10.0, -300.0]), "y": np.array([5.0, 1e3])}
    data = jnp.array([1.0, 2.0])
    optimum = maximise(badly_scaled, starts, data, tolerance=1e-12)
    assert optimum.converged.all()
    np.testing.assert_allclose(optimum.log_density, 0.0, atol=1e-8)
    np.testing.assert_allclose(optimum.values["x"], 0.8 * 1.0 + 0.6 * 2.0, atol=1e-3)
    np.testing.assert_allclose(optimum.values["y"], -0.6 * 1.0 + 0.8 * 2.0, atol=1e-3)


def test_steps_into_a_region_without_a_density_are_shortened():
    starts = {"x": np.array([[1e-3, 500.0], [3.0, 1.0]])}
    data = jnp.array([2.0, 7.0])
    optimum = maximise(walled, starts, data)
    assert optimum.converged.all()
    np.testing.assert_allclose(optimum.values["x"], [[2.0, 7.0]] * 2, rtol=1e-3)


def test_a_start_without_a_density_comes_last_and_has_not_converged():
    starts = {"x": np.array([[-1.0, -1.0], [3.0, 1.0]])}
    optimum = maximise(walled, starts, jnp.array([2.0, 7.0]))
    np.testing.assert_allclose(optimum.best()["x"], [2.0, 7.0], rtol=1e-3)
    assert optimum.log_density[1] == -np.inf
    np.testing.assert_array_equal(optimum.converged, [True, False])


def hollow(values, data):
    """The value is finite everywhere, the gradient is NaN within 0.1 of the top."""
    x = values["x"]
    return -jnp.sum(jnp.sqrt(jnp.maximum((x - data) ** 2 - 1e-2, 0.0)))


def test_points_without_a_gradient_are_not_stepped_to():
    optimum = maximise(hollow, {"x": np.array([[4.0], [-2.0]])}, jnp.asarray(1.0))
    for x in optimum.values["x"]:
        assert np.isfinite(jax.grad(hollow)({"x": x}, 1.0)["x"]).all()
    np.testing.assert_allclose(np.abs(optimum.values["x"] - 1.0), 0.1, atol=1e-3)


def test_starts_of_a_batch_do_not_disturb_each_other():
    starts = {"x": np.random.default_rng(5).normal(size=(4, 3))}
    starts["x"][2] = np.nan
    together = maximise(rosenbrock, starts, jnp.asarray(0.0), max_steps=20)
    order = []
    for lane in (0, 1, 3):
        alone = maximise(rosenbrock, {"x": starts["x"][[lane]]}, jnp.asarray(0.0), max_steps=20)
        place = int(np.argmin(np.abs(together.log_density[:3] - alone.log_density[0])))
        order.append(place)
        np.testing.assert_allclose(
            together.values["x"][place], alone.values["x"][0], rtol=1e-6, atol=1e-8
        )
        assert together.steps[place] == alone.steps[0]
    assert sorted(order) == [0, 1, 2]


@pytest.mark.parametrize("together", [2, 3, 8])
def test_how_many_are_evaluated_together_changes_nothing(together):
    starts = {"x": np.random.default_rng(5).normal(size=(5, 3))}
    alone = maximise(rosenbrock, starts, jnp.asarray(0.0), keep=2)
    found = maximise(rosenbrock, starts, jnp.asarray(0.0), keep=2, together=together)
    np.testing.assert_allclose(found.values["x"], alone.values["x"], atol=1e-3)
    np.testing.assert_allclose(found.log_density, alone.log_density, atol=1e-6)


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_who_interrupts_gets_an_answer_at_once_and_no_thread_stays(error):
    before = threading.active_count()

    def stop(steps, value):
        raise error

    with pytest.raises(error):
        maximise(rosenbrock, {"x": np.full((6, 9), -1.2)}, jnp.asarray(0.0), progress=stop)
    assert threading.active_count() == before


def test_a_density_that_falls_off_a_wall_near_its_top_is_climbed():
    """The top lies a millionth from where there is nothing, and the way there bends."""

    def cliff(values, data):
        x, y = values["x"]
        inside = x < data + 1e-6
        return jnp.where(inside, -100.0 * (y - x**2) ** 2 - (x - data) ** 2, jnp.nan)

    found = maximise(cliff, {"x": np.array([[-1.2, 1.0]])}, jnp.asarray(1.0))
    assert found.converged[0]
    assert found.log_density[0] == pytest.approx(0.0, abs=1e-4)


def two_peaks(values, data):
    """Two normal peaks of different height: which is found depends on the start."""
    x = values["x"]
    peaks = jnp.stack([-0.5 * (x - data) ** 2, -3.0 - 0.5 * (x + data) ** 2])
    return jnp.sum(jax.nn.logsumexp(peaks, axis=0))


@pytest.mark.parametrize(("keep", "peaks"), [(1, [10]), (2, [10, -10]), (3, [10, 10, -10])])
def test_keep_goes_on_with_the_best_starts_of_as_many_optima_as_there_are(keep, peaks):
    starts = {"x": np.array([-9.0, 9.0, -11.0, 11.5])[:, None]}
    data = jnp.asarray(10.0)
    every = maximise(two_peaks, starts, data)
    np.testing.assert_allclose(every.values["x"][:, 0], [10, 10, -10, -10], atol=1e-3)
    kept = maximise(two_peaks, starts, data, keep=keep)
    assert kept.log_density.shape == kept.converged.shape == kept.steps.shape == (keep,)
    np.testing.assert_allclose(kept.values["x"][:, 0], peaks, atol=1e-3)
    heights = [every.log_density[0 if peak > 0 else 2] for peak in peaks]
    np.testing.assert_allclose(kept.log_density, heights, atol=1e-6)


def test_starts_that_are_kept_go_on_as_they_would_have():
    """Each takes its own memory along when others are dropped and the rest change places."""
    starts = {"x": np.random.default_rng(8).normal(size=(5, 4))}
    every = maximise(rosenbrock, starts, jnp.asarray(0.0), max_steps=14)
    kept = maximise(rosenbrock, starts, jnp.asarray(0.0), max_steps=14, keep=4, trial_steps=7)
    assert len(kept.log_density) == 4
    for value, x in zip(kept.log_density, kept.values["x"], strict=True):
        place = int(np.argmin(np.abs(every.log_density - value)))
        np.testing.assert_allclose(x, every.values["x"][place], rtol=1e-7)


def test_max_steps_is_kept_and_told():
    start = {"x": np.full((1, 10), -1.2)}
    for most in (3, 25):
        short = maximise(rosenbrock, start, jnp.asarray(0.0), max_steps=most)
        assert not short.converged[0]
        assert short.steps[0] == most
    assert maximise(rosenbrock, start, jnp.asarray(0.0)).converged[0]


def test_trial_steps_say_when_starts_are_dropped():
    told = []
    maximise(
        two_peaks,
        {"x": np.array([[-3.0], [3.0]])},
        jnp.asarray(10.0),
        keep=1,
        trial_steps=2,
        max_steps=4,
        progress=lambda steps, value: told.append(steps),
    )
    assert told == [2, 4]


def test_progress_is_told_block_by_block():
    told = []
    optimum = maximise(
        rosenbrock,
        {"x": np.full((1, 10), -1.2)},
        jnp.asarray(0.0),
        max_steps=50,
        progress=lambda steps, value: told.append((steps, value)),
    )
    assert [steps for steps, _ in told] == [20, 40, 50]
    values = [value for _, value in told]
    assert values == sorted(values)
    assert values[-1] == pytest.approx(optimum.log_density[0])


@dataclass(frozen=True)
class Counted:
    """A log density that counts how often it is traced; equal ones are one to JAX."""

    name: str

    def __call__(self, values, data):
        traces[self.name] = traces.get(self.name, 0) + 1
        return -jnp.sum((values["x"] - data) ** 2)


traces: dict[str, int] = {}


def test_new_data_of_the_same_shape_compile_nothing():
    starts = {"x": np.zeros((2, 3))}
    first = maximise(Counted("one"), starts, jnp.arange(3.0))
    count = traces["one"]
    assert count > 0
    second = maximise(Counted("one"), {"x": np.ones((2, 3))}, 5.0 * jnp.arange(3.0), max_steps=50)
    assert traces["one"] == count
    np.testing.assert_allclose(first.best()["x"], np.arange(3.0), atol=1e-4)
    np.testing.assert_allclose(second.best()["x"], 5.0 * np.arange(3.0), atol=1e-4)
    maximise(Counted("one"), {"x": np.zeros((2, 4))}, jnp.arange(4.0))
    assert traces["one"] > count


def test_another_number_of_starts_compiles_nothing():
    """Starts are tried in batches of as many as are kept."""
    traced = []
    for count in (7, 2, 12):
        starts = {"x": np.random.default_rng(count).normal(size=(count, 3))}
        found = maximise(Counted("batches"), starts, jnp.arange(3.0), keep=2)
        assert found.log_density.shape == (2,)
        np.testing.assert_allclose(found.best()["x"], np.arange(3.0), atol=1e-4)
        traced.append(traces["batches"])
    assert traced[0] == traced[2] > 0


def chain(values, data):
    """A random walk of small steps, seen with noise: its directions curve very unlike."""
    x = values["x"]
    return -0.5 * jnp.sum(jnp.diff(x, axis=0) ** 2) / 1e-4 - 0.5 * jnp.sum((x - data) ** 2)


def test_roots_change_the_number_of_steps_and_not_the_optimum():
    n = 60
    B = np.diff(np.eye(n), axis=0)
    precision = np.eye(n) + B.T @ B / 1e-4
    data = np.random.default_rng(6).normal(size=(n, 2))
    exact = np.linalg.solve(precision, data)
    starts = {"x": np.random.default_rng(7).normal(size=(1, n, 2))}
    root = jnp.asarray(np.linalg.inv(np.linalg.cholesky(precision)).T)
    plain = maximise(chain, starts, jnp.asarray(data), tolerance=1e-10)
    rooted = maximise(chain, starts, jnp.asarray(data), tolerance=1e-10, roots={"x": root})
    assert rooted.converged[0]
    np.testing.assert_allclose(rooted.best()["x"], exact, atol=1e-4)
    np.testing.assert_allclose(plain.best()["x"], exact, atol=1e-2)
    assert rooted.steps[0] < 0.3 * plain.steps[0]


def test_values_come_back_in_the_shape_of_the_starts():
    starts = {"a": np.zeros((2, 3, 2)), "b": np.zeros(2)}

    def bowl(values, data):
        return -jnp.sum((values["a"] - data) ** 2) - (values["b"] + 1.0) ** 2

    data = jnp.arange(6.0).reshape(3, 2)
    optimum = maximise(bowl, starts, data)
    assert isinstance(optimum, Optimum)
    np.testing.assert_allclose(optimum.best()["a"], data, atol=1e-4)
    np.testing.assert_allclose(optimum.best()["b"], -1.0, atol=1e-4)
    assert optimum.values["a"].shape == (2, 3, 2)


def test_what_takes_more_memory_than_there_is_is_refused_before_it_is_run(monkeypatch):
    def large(values, data):
        x = values["x"][0] * jnp.ones((40_000, 40_000))
        return -jnp.sum(jnp.linalg.inv(x @ x))

    began = time.perf_counter()
    monkeypatch.setattr(programs, "free_memory", lambda: 2**32)
    with pytest.raises(InputError, match=r"log density: it takes \d+\.\d GB of memory, 4\.0 GB"):
        maximise(large, {"x": np.ones((1, 1))}, jnp.asarray(0.0))
    assert time.perf_counter() - began < 30.0


def test_free_memory_is_that_of_the_system():
    assert 2**20 < (programs.free_memory() or 0) < 2**50


def test_a_search_of_hours_is_told_of(monkeypatch):
    monkeypatch.setattr(optimise, "HOURS", 0.0)
    with pytest.warns(MotionWarning, match="the search may take up to .* hours: one evaluation"):
        maximise(rosenbrock, {"x": np.full((1, 3), -1.2)}, jnp.asarray(0.0))
