"""A clip in the space of its keyposes' components."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion.dataset import skeleton_of
from bayesmotion.motion.features import encode, layout_of
from bayesmotion.motion.kinematics import positions
from bayesmotion.motion.synthetic.dance import synthetic_dance
from bayesmotion.tasks.low_dimensional import low_dimensional


@pytest.fixture(scope="module")
def dance():
    return synthetic_dance(0, beats=8)


def test_poses_lie_in_a_space_of_that_size_and_the_path_is_kept(dance):
    low = low_dimensional(dance.motion, dance.keyposes, 2)
    layout = layout_of(skeleton_of(low), leave_out=())
    poses = encode(low, layout)[:, : layout.n_angles]
    singular = np.linalg.svd(poses - poses.mean(axis=0), compute_uv=False)
    assert singular[2] < 1e-6 * singular[0] < singular[1]
    np.testing.assert_allclose(
        low["root_position"].values, dance.motion["root_position"].values, atol=1e-9
    )


def test_more_dimensions_come_nearer_and_keyposes_are_met(dance):
    true = positions(dance.motion).values
    gaps = []
    for size in (1, 2, len(dance.keyposes) - 1):
        low = positions(low_dimensional(dance.motion, dance.keyposes, size)).values
        gaps.append(np.linalg.norm(low - true, axis=2)[dance.keyposes].mean())
    assert gaps[0] > gaps[1] > gaps[2]
    assert gaps[2] < 1e-2


def test_too_many_dimensions_are_refused(dance):
    with pytest.raises(InputError, match="dimensions were asked for"):
        low_dimensional(dance.motion, dance.keyposes, 40)
