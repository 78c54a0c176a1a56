"""The denoising study: errors and coverage of a small clip, and what the page tells of them."""

import numpy as np
import pytest

from bayesmotion.motion import split
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.studies.denoising import study
from bayesmotion.studies.denoising.report import markdown


@pytest.fixture(scope="module")
def walk():
    walkers = synthetic_walkers(("ann",), ("walk",), seconds=1.0, frame_rate=60.0)
    return split(walkers)["ann-walk"]


@pytest.fixture(scope="module")
def found(walk):
    return study.contest(walk, 3.0, 5.0, seed=0)


def test_noise_is_other_noise_at_every_level_and_the_same_of_one_seed(walk):
    def white(noise, seed):
        return (study.with_noise(walk, noise, seed)["angle"] - walk["angle"]).values / noise

    assert np.array_equal(white(1.0, 0), white(1.0, 0))
    assert not np.allclose(white(1.0, 0), white(3.0, 0))
    assert not np.allclose(white(1.0, 0), white(1.0, 1))
    assert np.rad2deg(white(3.0, 0).std()) == pytest.approx(1.0, rel=0.05)


def test_errors_are_millimetres_and_less_than_as_measured(walk, found):
    errors = found["error_mm"]
    assert study.error_mm(walk, walk["angle"].values) == 0.0
    assert 20.0 < errors["measured"] < 100.0
    assert errors["known"] < errors["laboratory"] < errors["measured"]
    for shares in found["coverage"].values():
        assert 0.3 < shares["50"] < 0.7
        assert 0.75 < shares["90"] < 1.0


def test_the_page_says_where_the_filter_is_nearer(found):
    worse = {**found, "error_mm": {**found["error_mm"], "estimated": 99.0}}
    settings = {"noises_degrees": [1.0, 3.0], "training": ["a"]}
    chosen = {"cutoff_hz": {"1": {"5": 1.0, "6": 2.0}, "3": {"5": 2.0, "6": 1.0}}}
    result = {"settings": settings, **chosen, "trials": {"a": {"1": found, "3": found}}}
    text = markdown(result)
    assert "is nearer than the 6 Hz filter at every level" in text
    assert "5 Hz at 1°, 6 Hz at 3°" in text
    result["trials"]["a"]["3"] = worse
    assert "At 3 degrees the 6 Hz filter is nearer: use that." in markdown(result)
    assert markdown({}) == ""
    result["trials"]["b"] = {"1": found}
    assert "| b |" not in markdown(result)


def test_the_variant_is_chosen_by_its_error_relative_to_the_first():
    names = list(study.VARIANTS)
    errors = {name: {"1": 2.0, "5": 10.0} for name in names}
    errors[names[1]] = {"1": 1.0, "5": 12.0}
    assert study.best_variant({"variants": errors}) == names[1]
    assert study.settings_of(names[2]).stretch_s == 4.0
