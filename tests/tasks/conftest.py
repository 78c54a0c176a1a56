"""Small fits that the tests of the tasks share."""

import dataclasses
import warnings

import numpy as np
import pytest

from bayesmotion.errors import MotionWarning
from bayesmotion.inference.methods import LocalLearning
from bayesmotion.inference.methods import fit as fit_model
from bayesmotion.inference.optimisation.map import fit_map
from bayesmotion.models.gait_pose import VARIANTS
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.motion.cycles import cycles_of
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.tasks import gait

RATE = 20.0
PEOPLE = ("ann", "ben", "cas", "dee", "eva", "fay")
POSES = 12


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
def with_novel():
    """Give a fit whose new people have so many novel style dimensions."""

    def give(fit, novel):
        factors = tuple(
            dataclasses.replace(factor, novel_dims=novel) for factor in fit.model.factors
        )
        return dataclasses.replace(fit, model=dataclasses.replace(fit.model, factors=factors))

    return give


@pytest.fixture(scope="session")
def gait_clips():
    return synthetic_walkers((*PEOPLE, "new"), ("walk",), seconds=2.6, styles=2)


@pytest.fixture(scope="session")
def gait_walks(gait_clips):
    return cycles_of(gait_clips, 1, poses=POSES)


@pytest.fixture(scope="session")
def trained_gait(gait_walks):
    """Give a gait-pose fit of all walkers but the new one, and the same ready for tasks."""
    known = gait_walks.isel(frame=gait_walks["subject"].values != "new")
    known = known.assign_coords(frame=np.arange(known.sizes["frame"]))
    # Synthetic people differ in two directions, which the surface has: nothing is their own.
    model = dataclasses.replace(VARIANTS["torus3"], subject_noise_sd=0.0)
    fit = gait.with_subject_residual(fit_model(model, known, method=LocalLearning(20)))
    return fit, gait.trained_of(fit)
