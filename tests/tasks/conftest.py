"""One small fit that the tests of the tasks share."""

import dataclasses
import warnings

import pytest

from bayesmotion.errors import MotionWarning
from bayesmotion.inference.map import fit_map
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.motion.synthetic import synthetic_walkers

RATE = 20.0


@pytest.fixture(scope="session")
def walkers():
    return synthetic_walkers(
        gaits=("walk", "run"), leave_out=[("ben", "run")], seconds=2.0, frame_rate=RATE
    )


@pytest.fixture(scope="session")
def circle_fit(walkers):
    with warnings.catch_warnings():
        # 120 steps are enough to forecast by; whether they converged is not the point here.
        warnings.simplefilter("ignore", MotionWarning)
        return fit_map(Multifactor(), walkers, starts=2, keep=1, max_steps=120)


@pytest.fixture(scope="session")
def with_spare():
    """Give a fit whose new people have so many spare style entries."""

    def give(fit, spare):
        factors = tuple(dataclasses.replace(factor, spare=spare) for factor in fit.model.factors)
        return dataclasses.replace(fit, model=dataclasses.replace(fit.model, factors=factors))

    return give
