"""The page on a fit: warnings first, every section, nothing asked of a network."""

import json
import re
import warnings

import numpy as np
import pandas as pd
import pytest

import bayesmotion as bm
from bayesmotion.report.blocks import LONG, Picture, Sentences, Table
from bayesmotion.report.sections import comparison

TITLES = [
    "Before you trust it", "Seen moving", "What was fitted to what",
    "Convergence, on what the data can tell", "Parameters", "Latent space",
    "Posterior predictive checks", "Forecasts",
]  # fmt: skip


@pytest.fixture(scope="module")
def page(fit, walks):
    clip = bm.split(walks)["ben-run"]
    return bm.report(fit, clips=clip, context=8, draws=20)


def section(page, title):
    """Return the section of a title."""
    (found,) = [one for one in page.sections if one.title == title]
    return found


def test_warnings_come_first_in_words(page, fit):
    assert [one.title for one in page.sections] == TITLES
    assert any("point estimate" in text for text in page.warnings)
    assert set(bm.diagnose(fit).problems) <= set(page.warnings)
    (block,) = page.sections[0].blocks
    assert block.texts == list(page.warnings)
    assert page.html.index(page.warnings[0]) < page.html.index(TITLES[2] + "</h2>")
    # Such a clip is a test: nothing says that it trained the fit.
    assert not any("trained the fit" in text for text in page.warnings)


def test_a_forecast_stands_beside_simple_ones_and_what_happened(page, fit, walks):
    table, picture = section(page, "Forecasts").blocks
    clip = bm.split(walks)["ben-run"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bm.MotionWarning)
        found = bm.forecast_scores(fit, clip, bm.forecast(fit, clip, context=8, horizon=10))
    row = table.frame.loc["ben-run"]
    assert row["forecast"] == pytest.approx(found.error, rel=1e-6)
    assert row["constant velocity"] == pytest.approx(found.baselines["constant_velocity"])
    assert isinstance(picture, Picture)
    assert "10 frames forecast from 8" in picture.caption


def test_what_was_drawn_is_told_in_units(page):
    said, _, table = section(page, "Posterior predictive checks").blocks
    assert table.frame.loc["speed", "unit"] == "m/s"
    low, high = table.frame["5 %"], table.frame["95 %"]
    outside = ~((low <= table.frame["recorded"]) & (table.frame["recorded"] <= high))
    assert f"{int(outside.sum())} lie outside" in said.texts[0]


def test_the_page_is_whole_in_a_browser(page, see, shot, tmp_path):
    path = page.write(tmp_path / "report.html")
    assert path.stat().st_size < 5e6
    seen = see(path, width=900, height=1100)
    frame = seen.page.frame_locator("iframe")
    frame.locator("html[data-ready=yes]").wait_for(state="attached")
    shot(seen, "report")
    # Every picture is one: none is broken.
    widths = seen.page.evaluate("[...document.images].map(i => i.naturalWidth)")
    assert len(widths) >= 3
    assert min(widths) > 100
    for link in seen.page.locator("nav a").all():
        assert seen.page.locator(link.get_attribute("href")).count() == 1
    assert not seen.errors
    assert not seen.requests
    phone = see(path, width=390, height=760, scheme="dark")
    assert phone.page.evaluate("document.documentElement.scrollWidth") <= 390
    assert max(phone.picture("h1")[0, 0]) < 60


def test_draws_are_diagnosed_and_compared(cycle_draws, cycle_mode):
    page = bm.report({"draws": cycle_draws, "mode": cycle_mode}, draws=40)
    _, table, picture = section(page, "draws: Convergence, on what the data can tell").blocks
    assert table.frame["R-hat"].max() == bm.diagnose(cycle_draws).figures["max_r_hat"]
    assert isinstance(picture, Picture)
    # They are of different recordings: that is said, and nothing breaks.
    assert "different data" in section(page, "Comparison").blocks[0].texts[0]


def test_fits_of_the_same_recordings_are_compared(cycle_mode):
    found, _ = comparison({"one": cycle_mode, "two": cycle_mode}, 10)
    sentences, table, _ = found.blocks
    assert any("predict alike" in text for text in sentences.texts)
    np.testing.assert_allclose(table.frame["elpd_diff"], 0.0, atol=1e-9)


def test_blocks_write_what_they_are_given():
    numbers = pd.DataFrame({"a": [1.23456, float("nan"), -3e-17], "b": ["<x>", "y", "z"]})
    html = Table(numbers, "A & B", ".2f").html()
    assert re.findall(r"<td>(.*?)</td>", html) == ["1.23", "&lt;x&gt;", "–", "y", "0.00", "z"]
    assert "A &amp; B" in html
    assert "<details>" not in html
    assert "<details>" in Table(pd.concat([numbers] * LONG), "long").html()
    assert Sentences(["<b>"], listed=True).html() == "<ul><li>&lt;b&gt;</li></ul>"


def test_the_command_writes_the_page(tmp_path, run, refused):
    model, recordings = bm.example("relevance_vectors")
    bm.fit(model, recordings, seed=0).save(tmp_path / "fit.nc")
    files = ["--out", tmp_path / "r.html", "--json", tmp_path / "r.json"]
    result = run("report", tmp_path / "fit.nc", *files)
    assert result.exit_code == 0, result.output
    told = json.loads((tmp_path / "r.json").read_text())
    assert told["sections"][0] == TITLES[0]
    assert any("point estimate" in text for text in told["warnings"])
    assert "it was trained on no bodies" in (tmp_path / "r.html").read_text()
    bm.write(bm.synthetic_walkers(("ann",), ("walk",), seconds=1.0), tmp_path / "w.bvh")
    told = refused(run("report", tmp_path / "fit.nc", "--clip", tmp_path / "w.bvh", *files))
    assert "it forecasts no motions" in told
