"""Draws that differ only by what no data can tell come together; others do not."""

import numpy as np
from scipy.stats import ortho_group

from bayesmotion.criticism.alignment import (
    align_components,
    align_phases,
    align_rotations,
    aligned,
)
from bayesmotion.fit import Fit

from .conftest import with_posterior


def spread(draws: np.ndarray) -> float:
    flat = draws.reshape(-1, *draws.shape[2:])
    return float(np.abs(flat - flat.mean(axis=0)).max())


def test_turned_and_reflected_points_come_together():
    random = np.random.default_rng(0)
    x = random.normal(size=(7, 3))
    turned = np.stack(
        [[x @ ortho_group.rvs(3, random_state=random) for _ in range(6)] for _ in range(2)]
    )
    assert spread(turned) > 1.0
    aligned = align_rotations(turned)
    assert spread(aligned) < 1e-9
    np.testing.assert_allclose(aligned[0, 0] @ aligned[0, 0].T, x @ x.T, atol=1e-9)


def test_points_of_another_shape_stay_apart():
    random = np.random.default_rng(1)
    x, other = random.normal(size=(2, 7, 3))
    aligned = align_rotations(np.stack([x, other])[None])
    assert spread(aligned) > 0.3


def test_swapped_components_come_together():
    random = np.random.default_rng(2)
    x = random.normal(size=(20, 4))
    swapped = np.stack(
        [x[:, random.permutation(4)] * random.choice([-1.0, 1.0], 4) for _ in range(8)]
    )
    aligned = align_components(swapped.reshape(2, 4, 20, 4))
    assert spread(aligned) < 1e-12


def test_a_rotation_is_not_mistaken_for_a_permutation():
    random = np.random.default_rng(3)
    x = random.normal(size=(20, 2))
    turn = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    assert spread(align_components(np.stack([x, x @ turn])[None])) > 0.3


def test_phases_shifted_together_come_together_whichever_way_time_runs():
    random = np.random.default_rng(4)
    phase, step = random.uniform(-np.pi, np.pi, 5), random.uniform(0.1, 0.3, 5)
    sign = random.choice([-1.0, 1.0], size=(2, 10, 1))
    shift = random.uniform(-np.pi, np.pi, size=(2, 10, 1))
    phases, steps = align_phases(sign * phase + shift, sign * step)
    assert spread(phases) < 1e-9
    assert spread(steps) < 1e-12
    # What does not change: the differences between clips, up to the direction of time.
    turned = np.sign(steps[0, 0, 0])
    found = np.exp(1j * turned * (phases[0, 0] - phases[0, 0, 0]))
    np.testing.assert_allclose(found, np.exp(1j * (phase - phase[0])), atol=1e-9)


def test_a_clip_that_moves_by_itself_is_not_aligned_away():
    phase = np.zeros((1, 4, 3))
    phase[0, :, 2] = [0.0, 0.4, -0.4, 0.2]
    phases, _ = align_phases(phase + np.array([0.0, 1.0, 2.0, 3.0])[:, None], np.ones((1, 4, 3)))
    differences = phases[0, :, 2] - phases[0, :, 1]
    np.testing.assert_allclose(differences, [0.0, 0.4, -0.4, 0.2], atol=1e-9)


def test_latent_paths_of_a_fit_come_together(drawn_gp_fit: Fit):
    random = np.random.default_rng(5)
    posterior = drawn_gp_fit.tree["posterior"].to_dataset().copy(deep=True)
    for draw in range(posterior.sizes["draw"]):
        Q = ortho_group.rvs(3, random_state=random)
        posterior["x"].values[:, draw] = 3.0 * posterior["x"].values[:, draw] @ Q
    turned = with_posterior(drawn_gp_fit, posterior, random)
    here, there = aligned(drawn_gp_fit), aligned(turned)
    # Both are the same paths, each set up to one rotation.
    one, other = (found["x"].values[0, 0] for found in (here, there))
    np.testing.assert_allclose(one @ one.T, other @ other.T, atol=1e-9)
    assert spread(turned.tree["posterior"]["x"].values) > 1.0
    assert spread(there["x"].values) < 0.5
    np.testing.assert_array_equal(there["gamma"], posterior["gamma"])
