"""Predictions where it is known how many modes the unknowns of new recordings have."""

import numpy as np
import pytest
import xarray as xr

import bayesmotion as bm


def test_an_angle_that_is_passed_twice_in_a_cycle_has_both_phases(cycle_mode):
    """On the way up and on the way down: the hip of one frame does not tell which."""
    level, cosine, sine = (cycle_mode.values()[name] for name in ("level", "cosine", "sine"))
    y = np.full((6, 2), np.nan)
    y[0, 0] = level[0] + 0.3 * np.hypot(cosine[0], sine[0])
    recordings = xr.Dataset({"y": (("frame", "feature"), y)}, {"feature": ["hip", "knee"]})
    found = bm.predict(cycle_mode, recordings)
    phase = np.arctan2(sine[0], cosine[0]) + np.arccos(0.3) * np.array([-1.0, 1.0])
    order = np.argsort(np.cos(found.unknowns["phase"] - phase[0]))[::-1]
    assert len(order) == 2
    np.testing.assert_allclose(np.cos(found.unknowns["phase"][order] - phase), 1.0, atol=1e-4)
    np.testing.assert_allclose(found.weight, 0.5, atol=0.01)
    # The knee goes either way; its mean lies between.
    knee = (level[1] + cosine[1] * np.cos(phase) + sine[1] * np.sin(phase)).mean()
    assert found.site().means()[0, 1] == pytest.approx(knee, abs=0.01)
