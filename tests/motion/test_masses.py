"""Masses of the joints."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion.masses import joint_masses
from bayesmotion.motion.skeleton import Joint, Skeleton
from bayesmotion.motion.synthetic.anthropometry import adult_skeleton


def test_masses_sum_to_one_are_symmetric_and_those_of_the_table():
    skeleton = adult_skeleton("ann", 1.7)
    mass = joint_masses(skeleton)
    assert mass.sum() == pytest.approx(1.0)
    at = {name: float(mass[skeleton.index(name)]) for name in skeleton.names}
    for name in skeleton.names:
        if name.startswith("l") and "r" + name[1:] in at:
            assert at[name] == pytest.approx(at["r" + name[1:]])
    # The thigh's upper end carries what its centre of mass leaves to it.
    assert at["lfemur"] == pytest.approx(0.100 * (1 - 0.433))
    assert at["ltibia"] == pytest.approx(0.100 * 0.433 + 0.0465 * (1 - 0.433))
    trunk = np.array([at["root"], at["lowerneck"]])
    assert trunk.sum() == pytest.approx(0.497)


def test_other_names_are_refused():
    skeleton = Skeleton("odd", (Joint("hips", -1, (0.0, 0.0, 0.0)),))
    with pytest.raises(InputError, match="no joint is found for pelvis"):
        joint_masses(skeleton)
