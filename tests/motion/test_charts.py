"""Rotations as vectors about a slow path: there and back, whatever the order of the angles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bayesmotion.motion.charts import FAR, Charts
from bayesmotion.motion.euler import continuous_angles
from bayesmotion.motion.skeleton import Joint, Skeleton

RATE = 60.0


def body(order="xyz"):
    hip = Joint("hip", -1, (0.0, 0.0, 0.0), channels=tuple(f"r{axis}" for axis in order))
    knee = Joint("knee", 0, (0.0, -1.0, 0.0), channels=("rx",))
    return Skeleton("body", (hip, knee))


def turning(turns=0.2, seed=0):
    """A hip that turns about the vertical so many times, and nods, over five seconds."""
    t = np.linspace(0.0, 1.0, 300)[:, None]
    nod = 0.3 * np.sin(9.0 * t + np.random.default_rng(seed).uniform(0, 6, 3))
    return Rotation.from_euler("y", 2 * np.pi * turns * t) * Rotation.from_euler("xyz", nod)


def recorded(turn, order="XYZ"):
    knee = np.linspace(0.0, 1.0, len(turn))[:, None]
    return np.column_stack([continuous_angles(turn, order), knee])


@pytest.mark.parametrize("turns", [0.2, 3.0])
def test_there_and_back(turns):
    angle = recorded(turning(turns))
    charts = Charts.of(body(), body().dofs, angle, RATE)
    vectors = charts.vectors(angle)
    assert np.linalg.norm(vectors[:, :3], axis=1).max() < FAR
    np.testing.assert_array_equal(vectors[:, 3], angle[:, 3])
    back, _ = charts.angles(vectors, np.ones(angle.shape))
    np.testing.assert_allclose(back, angle, atol=1e-9)


@pytest.mark.parametrize("turns", [0.2, 3.0])
def test_neither_order_nor_heading_matter(turns):
    turn = turning(turns)
    heading = Rotation.from_euler("y", 1.9)
    expected = Charts.of(body(), body().dofs, recorded(turn), RATE).vectors(recorded(turn))
    for order, world in (("ZXY", Rotation.identity()), ("XYZ", heading)):
        angle = recorded(world * turn, order)
        own = body(order.lower())
        found = Charts.of(own, own.dofs, angle, RATE).vectors(angle)
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_gaps_stay_gaps_and_can_be_filled():
    turn = turning(3.0)
    angle = recorded(turn)
    cut = angle.copy()
    cut[100:130, :3] = np.nan
    charts = Charts.of(body(), body().dofs, cut, RATE)
    vectors = charts.vectors(cut)
    assert np.isnan(vectors[100:130, :3]).all()
    assert np.isfinite(np.delete(vectors, np.s_[100:130], axis=0)).all()
    vectors[100:130, :3] = np.linspace(vectors[99, :3], vectors[130, :3], 32)[1:-1]
    filled, _ = charts.angles(vectors, np.ones(cut.shape))
    made = Rotation.from_euler("XYZ", filled[100:130, :3])
    assert (made.inv() * turn[100:130]).magnitude().max() < 0.5
    np.testing.assert_allclose(np.delete(filled - angle, np.s_[100:130], axis=0), 0.0, atol=1e-9)


def test_a_joint_of_which_one_angle_is_missing_keeps_its_angles():
    angle = recorded(turning())
    angle[50, 1] = np.nan
    assert Charts.of(body(), body().dofs, angle, RATE).each == ()


def test_the_sds_of_angles_are_those_of_draws():
    angle = recorded(turning())
    charts = Charts.of(body(), body().dofs, angle, RATE)
    vectors = charts.vectors(angle)
    sd = np.tile([0.01, 0.02, 0.005, 0.1], (300, 1))
    _, found = charts.angles(vectors, sd)
    random = np.random.default_rng(1)
    drawn = np.stack([
        charts.angles(vectors + sd * random.normal(size=sd.shape), sd)[0] for _ in range(400)
    ])  # fmt: skip
    np.testing.assert_allclose(drawn.std(axis=0)[:, :3], found[:, :3], rtol=5 * np.sqrt(0.5 / 400))
    np.testing.assert_array_equal(found[:, 3], 0.1)
