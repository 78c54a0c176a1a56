"""The classical tensor: exact at full rank, least squares below, the paper's rule."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.studies.keypose.hosvd import hosvd, paper_rule


@pytest.mark.parametrize("shape", [(7, 3, 4), (30, 2, 3), (5, 2, 3, 2)])
def test_full_ranks_give_the_tensor_back(shape):
    tensor = np.random.default_rng(0).normal(size=shape)
    found = hosvd(tensor)
    np.testing.assert_allclose(found.tensor(), tensor, atol=1e-10)
    for factor, length in zip(found.factors, shape, strict=True):
        np.testing.assert_allclose(factor.T @ factor, np.eye(length), atol=1e-12)


def test_one_reduced_mode_is_the_truncated_svd_of_that_unfolding():
    tensor = np.random.default_rng(1).normal(size=(9, 3, 4))
    flat = tensor.reshape(9, -1)
    left, singular, right = np.linalg.svd(flat, full_matrices=False)
    best = (left[:, :2] * singular[:2]) @ right[:2]
    np.testing.assert_allclose(hosvd(tensor, (2, 3, 4)).tensor().reshape(9, -1), best, atol=1e-10)


def test_the_rule_names_noisy_copies_and_not_shuffled_ones():
    random = np.random.default_rng(3)
    level = np.array([(i, j) for i in range(3) for j in range(4)])
    x = random.normal(size=(12, 10))
    joint = np.repeat(np.arange(5), 2)
    rule = paper_rule(x, level, joint, np.arange(5.0), rank=10)
    probes = x + 0.05 * random.normal(size=x.shape)
    for mode in (0, 1):
        assert (rule.distances(probes, mode).argmin(axis=1) == level[:, mode]).all()
    shuffled = probes[:, ::-1]
    assert (rule.distances(shuffled, 1).argmin(axis=1) == level[:, 1]).mean() < 0.8


def test_the_weight_of_a_joint_counts():
    random = np.random.default_rng(4)
    level = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
    x = random.normal(size=(4, 6))
    joint = np.repeat(np.arange(3), 2)
    none = paper_rule(x, level, joint, np.array([0.0, 1.0, 1.0]), rank=4)
    moved = none.cells + np.array([9.0, 9.0, 0, 0, 0, 0])
    flat = paper_rule(x, level, joint, np.ones(3), rank=4)
    assert none.distances(moved, 0).sum() != pytest.approx(flat.distances(moved, 0).sum())


def test_missing_cells_are_refused():
    with pytest.raises(InputError, match="no segment of the levels"):
        paper_rule(np.zeros((3, 2)), np.array([(0, 0), (1, 0), (0, 1)]), np.zeros(2, int),
                   np.ones(1), rank=1)  # fmt: skip
    with pytest.raises(InputError, match="missing entries"):
        hosvd(np.full((2, 2, 2), np.nan))
    with pytest.raises(InputError, match="do not fit the shape"):
        hosvd(np.ones((2, 2, 2)), (3, 1, 1))
