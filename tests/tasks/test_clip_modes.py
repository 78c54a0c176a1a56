"""Modes of a new clip's unknowns: all that are found, each by its posterior mass."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
from numpyro import distributions as dist

from bayesmotion.motion.synthetic import synthetic_truth
from bayesmotion.tasks.clip_modes import ALIKE, log_mass, modes_of, predict, search
from bayesmotion.tasks.forecast import forecast, new_clip

GIVEN, HORIZON = 8, 12


class Peak(NamedTuple):
    """A density of two normal sites and a positive one, all of it about one mode."""

    share: float
    sd: float

    def program(self, width):
        numpyro.factor("share", jnp.log(self.share))
        numpyro.sample("a", dist.Normal(0.0, self.sd * width).expand([2]).to_event(1))
        numpyro.sample("b", dist.Gamma(400.0, 4.0))


@pytest.mark.parametrize("sd", [0.01, 0.7])
def test_the_mass_about_a_mode_is_its_integral_whatever_its_width(sd):
    at = {"a": jnp.zeros(2), "b": jnp.log(jnp.asarray(399.0 / 4.0))}
    found = log_mass(Peak(0.3, sd), at, (1.5,))
    assert found + 1.5 * np.log(2.0 * np.pi) == pytest.approx(np.log(0.3), abs=2e-3)


@pytest.fixture(scope="module")
def clip():
    return synthetic_truth(gaits=("walk", "run"), seconds=2.0, frame_rate=20.0).cell("ben", "run")


@pytest.fixture(scope="module")
def found(circle_fit, clip):
    new = new_clip(circle_fit, clip, given=GIVEN, horizon=HORIZON)
    optimum = search(circle_fit, new.seen)
    modes = modes_of(circle_fit, new.seen, optimum)
    return optimum, modes, *predict(circle_fit, new.whole, modes)


def test_all_modes_that_differ_are_kept_the_highest_first(circle_fit, found):
    optimum, every, modes, mixture = found
    assert len(every.values) >= optimum.converged.sum()
    assert len(modes.values) == len(mixture.weight) >= 1
    assert mixture.weight.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(
        np.log(mixture.weight), modes.log_mass - np.logaddexp.reduce(modes.log_mass)
    )
    for one in range(len(modes.values)):
        for other in range(one):
            apart = np.abs(mixture.mean[one] - mixture.mean[other])
            assert np.max(apart / circle_fit.training.encoding.spread) > ALIKE
    for name, value in modes.values[0].items():
        np.testing.assert_array_equal(value, every.values[0][name])


def test_a_forecast_is_the_mixture_of_its_modes(circle_fit, clip, found):
    predicted = forecast(circle_fit, clip, given=GIVEN, horizon=HORIZON)
    mixture = found[3]
    np.testing.assert_allclose(predicted.mean, mixture.means())
    within = np.tensordot(mixture.weight, mixture.sd**2, 1)
    assert np.all(predicted.sd**2 >= within * (1.0 - 1e-9))
    best = int(np.argmax(mixture.weight))
    for name, value in predicted.values.items():
        np.testing.assert_allclose(value, found[2].values[best][name])
