"""Predictions where it is known how many modes the unknowns of new recordings have."""

from dataclasses import dataclass, replace

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


def test_predictions_average_over_what_the_context_leaves_open(mean_cycle, cycle_mode):
    """Of four frames the pace is hardly told: far ahead the mean lies near the cycle's level."""

    @dataclass(frozen=True)
    class Averaging(mean_cycle):
        unknown_draws: int = 400

    values = {name: np.asarray(v) for name, v in cycle_mode.values().items()}
    frames, context = np.arange(60.0), 4

    def mean(phase, pace):
        theta = phase + pace * frames[:, None]
        return values["level"] + np.cos(theta) * values["cosine"] + np.sin(theta) * values["sine"]

    y = np.full((60, 2), np.nan)
    noise = values["noise"] * np.random.default_rng(1).normal(size=(context, 2))
    y[:context] = mean(1.0, 0.35)[:context] + noise
    recordings = xr.Dataset({"y": (("frame", "feature"), y)}, {"feature": ["hip", "knee"]})
    # Brute force: all phases and paces on a grid.
    cells = [(a, b) for a in np.linspace(0.0, 2.0, 81) for b in np.linspace(0.15, 0.6, 181)]
    means = np.stack([mean(*cell) for cell in cells])
    misfit = ((y[:context] - means[:, :context]) / values["noise"]) ** 2
    away = (np.log([pace for _, pace in cells]) - np.log(2 * np.pi / 20.0)) / 0.2
    log_mass = -0.5 * misfit.sum(axis=(1, 2)) - 0.5 * away**2 - np.log([p for _, p in cells])
    weight = np.exp(log_mass - log_mass.max())
    weight /= weight.sum()
    exact = np.tensordot(weight, means, 1)
    sd = np.sqrt(np.tensordot(weight, (means - exact) ** 2, 1) + values["noise"] ** 2)
    found = bm.predict(replace(cycle_mode, model=Averaging()), recordings)
    mode = bm.predict(cycle_mode, recordings)
    # Of 400 weighted draws a mean is known to about a fifteenth of an sd.
    assert np.abs((found.site().means() - exact) / sd).max() < 4.0 / 15.0
    np.testing.assert_allclose(found.site().sds(), sd, rtol=0.15)
    assert np.abs((mode.site().means() - exact) / sd).max() > 0.5
    assert (mode.site().sds()[-10:] < 0.5 * sd[-10:]).all()
    assert found.weight.sum() == pytest.approx(1.0)
    assert found.log_evidence == pytest.approx(mode.log_evidence)
