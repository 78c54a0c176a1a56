"""Low-dimensional motion: the classical and the probabilistic solution coincide."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.optimisation.optimise import maximise
from bayesmotion.studies.keypose.pca import ProbabilisticPCA, uniform_frames
from bayesmotion.tasks.low_dimensional import components


@pytest.fixture(scope="module")
def poses():
    random = np.random.default_rng(0)
    return random.normal(size=(40, 6)) * np.array([4, 3, 2, 1, 0.5, 0.2]) + 1.0


def test_all_components_give_the_poses_back_and_shares_grow(poses):
    space = components(poses)
    np.testing.assert_allclose(space.low_dimensional(poses, 6), poses, atol=1e-12)
    assert (np.diff(space.covered()) > 0).all()
    assert space.covered()[-1] == pytest.approx(1.0)
    errors = [np.square(space.low_dimensional(poses, q) - poses).sum() for q in (1, 2, 3)]
    np.testing.assert_allclose(errors, 40 * (space.variance.sum() - np.cumsum(space.variance)[:3]))


def test_the_mode_is_the_classical_solution(poses):
    space, q = components(poses), 2
    random = np.random.default_rng(1)
    starts = {
        "mean": np.zeros((2, 6)),
        "W": random.normal(size=(2, 6, q)),
        "log_noise": np.zeros(2),
    }
    density = ProgramDensity(ProbabilisticPCA(q))
    found = maximise(density, starts, (poses,), max_steps=400, tolerance=1e-13).best()
    noise = space.variance[q:].mean()
    assert np.exp(2 * found["log_noise"]) == pytest.approx(noise, rel=1e-4)
    np.testing.assert_allclose(found["mean"], space.mean, atol=1e-3)
    basis = space.basis[:, :q]
    expected = basis * (space.variance[:q] - noise) @ basis.T
    np.testing.assert_allclose(found["W"] @ found["W"].T, expected, atol=2e-3)


def test_uniform_frames_are_evenly_spread():
    assert uniform_frames(100, 4).tolist() == [12, 37, 62, 87]
    assert uniform_frames(100, 4, 0.0).tolist() == [0, 25, 50, 75]


def test_bad_input_is_told(poses):
    with pytest.raises(InputError, match="all alike"):
        components(np.ones((4, 3)))
    with pytest.raises(InputError, match="dimensions"):
        components(poses).low_dimensional(poses, 7)
