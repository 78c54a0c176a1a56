"""The study of gaps: what it compares with, and all of it in a small setting."""

import numpy as np
import pytest

from bayesmotion.motion import make_markers, write
from bayesmotion.studies.gaps import baselines, report, study


def markers(frames=240, seed=0):
    """A body that walks, bends and turns, in mm."""
    random, t = np.random.default_rng(seed), np.arange(frames) / 60.0
    shape, ways = 300.0 * random.normal(size=(9, 3)), 40.0 * random.normal(size=(9, 3))
    position = shape + np.sin(6.0 * t)[:, None, None] * ways
    position = position + np.stack([800.0 * t, 0.0 * t, 0.0 * t], axis=1)[:, None]
    names = [f"M{number}" for number in range(9)]
    return make_markers(names, position, frame_rate=60.0, clip="x", metres=0.001)


@pytest.mark.parametrize("way", ["rigid", "principal_components", "gapfill_rigid"])
def test_others_fill_in_what_is_rigid_exactly(way):
    if way.startswith("gapfill"):
        pytest.importorskip("gapfill")
    position = markers()["position"].values - 0.0
    still = position[:1] + np.linspace(0.0, 500.0, len(position))[:, None, None]
    given = still.copy()
    given[90:120, 4] = np.nan
    whole = baselines.baselines()[way](given)
    np.testing.assert_allclose(whole, still, atol=1e-6)


def test_a_gap_is_cut_where_markers_are_seen():
    position = markers()["position"].values.copy()
    position[:, :4] = np.nan
    given, lost = study.cut(position, 30, 3, np.random.default_rng(0))
    assert lost.sum() == 90
    assert not lost[:, :4].any()
    assert np.isnan(given[lost]).all()
    np.testing.assert_array_equal(given[~lost], position[~lost])


def test_the_study_runs_through(tmp_path, monkeypatch):
    folder = tmp_path / "benchmarks" / "gaps"
    folder.mkdir(parents=True)
    for seed, name in enumerate(study.RECORDINGS):
        write(markers(seed=seed), folder / f"{name}.c3d")
    monkeypatch.setattr(study, "SECONDS", (0.5,))
    monkeypatch.setattr(study, "MARKERS", (1,))
    monkeypatch.setattr(study, "REPETITIONS", 2)
    result = study.reproduce(tmp_path, tmp_path / "out", say=lambda line: None)
    errors = study.errors_of(result, "fill_gaps", "0.5", "1")
    assert errors.shape == (8,)
    assert errors.mean() < 0.2 * study.errors_of(result, "spline", "0.5", "1").mean()
    assert "`bm.fill_gaps`" in report.markdown(result)
