import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.tasks.cycles import cycle_distance, fold


def motion(phase: np.ndarray, size: float = 1.0) -> np.ndarray:
    return np.stack([size * np.cos(phase), 0.3 * np.sin(2 * phase), 0.1 + 0 * phase], axis=1)


def test_fold_recovers_the_cycle_from_frames_at_any_phase():
    phase = 0.7 + 0.23 * np.arange(40)
    cycle = fold(motion(phase), phase)
    np.testing.assert_allclose(cycle, motion(2 * np.pi * np.arange(60) / 60), atol=1e-10)


def test_distance_does_not_see_where_the_phase_starts():
    phase = 0.23 * np.arange(40)
    # The second motion counts its phase from another pose, ten of sixty points on.
    shifted = fold(motion(phase), phase + 2 * np.pi * 10 / 60)
    assert cycle_distance(fold(motion(phase), phase), shifted) < 1e-10


def test_distance_is_the_mean_norm_of_the_difference():
    phase = 0.1 * np.arange(70)
    one, other = fold(motion(phase), phase), fold(motion(phase) + np.array([3.0, 0.0, 4.0]), phase)
    assert cycle_distance(one, other) == pytest.approx(5.0)


def test_part_of_a_cycle_is_refused():
    phase = 0.05 * np.arange(60)
    with pytest.raises(InputError, match="one whole cycle"):
        fold(motion(phase), phase)
