"""Comparison: the model the data came from wins, errors are honest, other data are refused."""

import arviz_stats as azs
import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.evaluate.compare import compare, compare_scores
from bayesmotion.evaluate.loo import elpd
from bayesmotion.fit import Fit

from .conftest import draws_around, edited


def scores(values: np.ndarray, clips: list[str], k=None):
    coords = {"clip": ("point", np.array(clips)), "frame": ("point", np.arange(len(values)))}
    points = xr.DataArray(values, dims="point", coords=coords)
    k_hat = None if k is None else xr.DataArray(k, points.coords, ["point"])
    return elpd(points, n_samples=1000, k_hat=k_hat)


def test_differences_and_weights_are_those_of_arviz():
    random = np.random.default_rng(0)
    clips = ["a"] * 60 + ["b"] * 60
    one, other = random.normal(size=(2, 120))
    made = {"one": scores(one, clips), "other": scores(other - 0.1, clips)}
    here, there = compare_scores(made).table, azs.compare(made, round_to="none")
    for column in ("elpd", "elpd_diff", "dse", "se"):
        np.testing.assert_allclose(here[column].astype(float), there[column].astype(float))
    np.testing.assert_allclose(here["weight"], there["weight"], atol=1e-3)


def test_scores_of_many_features_do_not_underflow():
    random = np.random.default_rng(1)
    clips = ["a"] * 100
    far = -5000.0 + random.normal(size=100)
    table = compare_scores({"one": scores(far, clips), "other": scores(far - 2.0, clips)}).table
    assert float(table.loc["one", "weight"]) == pytest.approx(1.0, abs=1e-3)
    assert float(table.loc["one", "elpd"]) == pytest.approx(far.sum())


def test_the_error_over_clips_sees_that_frames_of_a_clip_are_alike():
    random = np.random.default_rng(2)
    clips = [c for c in "abcdef" for _ in range(50)]
    base = random.normal(size=300)
    by_clip = random.normal(size=6)
    shared = np.repeat(by_clip, 50)
    table = compare_scores(
        {"one": scores(base, clips), "other": scores(base - shared, clips)}
    ).table
    row = table.iloc[1]
    assert float(row["dse_clips"]) > 5 * float(row["dse"])
    sums = 50 * by_clip
    assert float(row["dse_clips"]) == pytest.approx(np.sqrt(6 * np.var(sums, ddof=1)), rel=1e-6)


def test_high_k_and_near_ties_are_told():
    clips = ["a"] * 50 + ["b"] * 50
    values, k = np.zeros(100), np.zeros(100)
    k[:3] = 0.9
    found = compare_scores({"one": scores(values, clips), "other": scores(values - 0.01, clips, k)})
    text = " ".join(found.sentences)
    assert "3 of 100 points" in text
    assert "they predict alike" in text


def test_a_fit_with_the_wrong_noise_loses(cycle_mode: Fit):
    good = draws_around(cycle_mode, size=1e-3)
    bad = edited(good, "noise", lambda v: v * 10.0)
    found = compare({"good": good, "bad": bad})
    assert list(found.table.index) == ["good", "bad"]
    # By hand: an entry loses log 10 - (1 - 1 / 100) / 2, of 120 of them.
    expected = -120 * (np.log(10.0) - 0.5 * (1.0 - 0.01))
    assert found.table.loc["bad", "elpd_diff"] == pytest.approx(expected, rel=0.1)
    assert "good is ahead of bad" in found.sentences[0]


def test_other_data_and_single_fits_are_refused(cycle_mode: Fit):
    other = Fit(cycle_mode.model, cycle_mode.motion, cycle_mode.tree.copy())
    other.tree.attrs["data_hash"] = "another"
    with pytest.raises(InputError, match="different data"):
        compare({"a": cycle_mode, "b": other})
    with pytest.raises(InputError, match="at least two"):
        compare({"a": cycle_mode})


def test_point_estimates_are_compared_with_a_caution(cycle_mode: Fit):
    found = compare({"a": cycle_mode, "b": cycle_mode})
    assert "are held" in found.sentences[-1]
    assert found.table["elpd_diff"].abs().max() == 0.0


def test_other_points_are_refused():
    with pytest.raises(InputError, match="other points"):
        compare_scores(
            {"a": scores(np.zeros(4), list("aabb")), "b": scores(np.zeros(3), list("aab"))}
        )
