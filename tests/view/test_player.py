"""The player in a real browser: what is seen, what happens, and that nothing leaves the page."""

import json
import wave
from dataclasses import replace

import numpy as np
import pytest

import bayesmotion as bm
from bayesmotion.view.scene import Ghosts, Scene
from bayesmotion.view.tracks import tracks_of_motion
from bayesmotion.view.viewer import LARGEST, View

# Pixels of bodies in the middle of the scene differ from those of paper and floor.
STRONG = 60


@pytest.fixture(scope="module")
def forecast_view(walks):
    """What happened, and a mean with 12 draws that part from it after 8 frames."""
    (truth,) = tracks_of_motion(bm.split(walks)["ann-run"], "truth", names=("truth",))
    ahead = np.maximum(np.arange(18) - 7, 0)[:, None, None] / 10
    apart = 0.25 * ahead * np.random.default_rng(0).normal(size=(12, 1, *truth.where.shape[1:]))
    where = truth.where + 0.15 * ahead
    ghosts = Ghosts(where + apart, 0.4 * ahead[..., 0] * np.ones(where.shape[:2]))
    mean = replace(truth, name="forecast", role="mean", where=where, context=8, ghosts=ghosts)
    return View(Scene("run", (truth, mean)))


@pytest.fixture(scope="module")
def forecast_page(forecast_view, tmp_path_factory):
    return forecast_view.write(tmp_path_factory.mktemp("pages") / "forecast.html")


@pytest.fixture(scope="module")
def walks_page(walks, tmp_path_factory):
    return bm.view(walks).write(tmp_path_factory.mktemp("pages") / "walks.html")


def strong(picture):
    """Return how many pixels are far from the colour of the paper."""
    paper = picture[0, 0]
    return int((np.abs(picture - paper).max(axis=2) > STRONG).sum())


def test_bodies_are_seen_and_move_when_it_plays(forecast_page, play):
    seen = play(forecast_page)
    first = seen.picture()
    assert strong(first) > 1500
    seen.page.locator("#play").click()
    seen.page.wait_for_function("player.state().frame >= 3")
    assert seen.state("playing") is True
    assert (np.abs(seen.picture() - first).max(axis=2) > STRONG).sum() > 500
    seen.page.locator("#play").click()
    assert seen.state("playing") is False
    # It stands still.
    stopped = seen.picture()
    assert np.array_equal(stopped, seen.picture())
    # A control: without its bodies the scene is paper and floor.
    for box in seen.page.locator("#tracks input").all():
        box.uncheck()
    assert strong(seen.picture()) < 0.05 * strong(first)
    assert not seen.errors
    assert not seen.requests


def test_the_scrubber_goes_to_a_frame_and_tells_context_from_forecast(forecast_page, play):
    seen = play(forecast_page)
    scrubber, clock = seen.page.locator("#scrubber"), seen.page.locator("#clock")
    assert scrubber.get_attribute("max") == "17"
    for frame, part in ((7, "context"), (8, "forecast")):
        scrubber.fill(str(frame))
        seen.run("0")
        assert seen.state("frame") == frame
        assert clock.inner_text() == f"{frame / 15:.2f} s · frame {frame}/17 · {part}"
    # The mark on the line stands between the two: 7.5 of 17 frames.
    line, told = (seen.page.locator(name).bounding_box() for name in ("#parts", "#told"))
    assert told["width"] / line["width"] == pytest.approx(7.5 / 17, abs=0.01)


def test_ghosts_are_switched_off_and_on(forecast_page, play):
    seen = play(forecast_page)
    seen.run("player.seek(17)")
    on = seen.picture()
    assert seen.state("drawsShown") == 12
    seen.page.locator("#ghosts").uncheck()
    seen.run("0")
    off = seen.picture()
    assert seen.state("drawsShown") == 0
    assert (np.abs(on - off).max(axis=2) > STRONG // 2).sum() > 300
    seen.page.keyboard.press("g")
    seen.run("0")
    assert np.array_equal(seen.picture(), on)


def test_keys_play_and_step(forecast_page, play):
    seen = play(forecast_page)
    for key, frame in (("ArrowRight", 1), ("Shift+ArrowRight", 11), ("ArrowLeft", 10), ("End", 17)):
        seen.page.keyboard.press(key)
        assert seen.state("frame") == frame
    seen.page.keyboard.press("Home")
    seen.page.keyboard.press(" ")
    seen.page.wait_for_function("player.state().frame > 0")
    seen.page.keyboard.press(" ")
    assert seen.state("playing") is False


def test_turning_and_zooming_change_the_view(forecast_page, play):
    seen = play(forecast_page)
    before = seen.picture()
    box = seen.page.locator("#scene").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    seen.page.mouse.move(x, y)
    seen.page.mouse.down()
    seen.page.mouse.move(x + 120, y + 20, steps=3)
    seen.page.mouse.up()
    seen.run("0")
    turned = seen.picture()
    assert (np.abs(turned - before).max(axis=2) > STRONG).sum() > 500
    seen.page.mouse.wheel(0, -400)
    seen.run("0")
    assert strong(seen.picture()) > 1.3 * strong(turned)


def test_clips_are_beside_each_other_or_in_one_place(walks_page, play):
    seen = play(walks_page, scheme="dark")
    assert seen.state("panels") == 4
    assert seen.page.locator("#labels").inner_text().split() == [
        "ann-walk", "ann-run", "ben-walk", "ben-run",
    ]  # fmt: skip
    seen.page.locator("#beside").uncheck()
    assert seen.state("panels") == 1
    # Dark where the reader's system is.
    assert seen.picture()[0, 0].max() < 60
    assert not seen.errors


def test_colours_tell_sides_and_uncertainty(forecast_page, play):
    seen = play(forecast_page)
    seen.run("player.seek(17)")
    pictures = []
    for colour in ("track", "side", "uncertainty"):
        seen.page.locator("#colour").select_option(colour)
        seen.run("0")
        # The scale stands above, where it is.
        pictures.append(seen.picture()[-350:])
    for one, other in ((0, 1), (1, 2), (0, 2)):
        assert (np.abs(pictures[one] - pictures[other]).max(axis=2) > STRONG).sum() > 300
    assert "mm" in seen.page.locator("#scale").inner_text()


def test_it_fits_a_phone(forecast_page, play):
    seen = play(forecast_page, width=390, height=760)
    assert seen.page.evaluate("document.documentElement.scrollWidth") <= 390
    assert seen.page.evaluate("document.documentElement.scrollHeight") <= 760
    assert seen.page.locator("#scene").bounding_box()["height"] > 300
    assert strong(seen.picture()) > 1000


def test_a_long_forecast_with_many_draws_plays_and_is_small(play, tmp_path):
    """2,000 frames and 50 draws of a body: 25 pictures a second, or it says what it left out."""
    (walk,) = tracks_of_motion(bm.synthetic_walkers(("ann",), ("walk",), seconds=2000 / 30))
    random, (n, j, _) = np.random.default_rng(0), walk.where.shape
    apart = 0.1 * np.sin(np.arange(n)[:, None, None] / 15 + 6 * random.random((50, 1, j, 3)))
    drawn = walk.where + apart + 0.003 * random.normal(size=apart.shape)
    track = replace(walk, role="mean", context=300, ghosts=Ghosts(drawn, apart[0, :, :, 0]))
    path = View(Scene("long", (track,))).write(tmp_path / "long.html")
    assert path.stat().st_size < 1e6 * LARGEST
    seen = play(path)
    assert (seen.state("frames"), seen.state("draws")) == (2000, 50)
    seen.run("player.play(true)")
    # Two slow seconds, and it leaves something out.
    for _ in range(8):
        seen.page.wait_for_timeout(1000)
        if seen.state("pictures") >= 25 or seen.page.locator("#notice").inner_text():
            break
    seen.run("player.play(false)")
    shown, told = seen.state("drawsShown"), seen.page.locator("#notice").inner_text()
    assert seen.state("pictures") >= 25 or "25 pictures a second" in told
    left_out = shown < 50 or seen.state("sharpness") < 1
    assert left_out == bool(told)
    if shown < 50:
        assert f"{shown} of 50 draws" in told


def test_sound_is_in_step(walks, play, tmp_path):
    with wave.open(str(tmp_path / "hum.wav"), "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(2)
        sound.setframerate(8000)
        hum = 3000 * np.sin(np.arange(4 * 8000) / 6)
        sound.writeframes(hum.astype("<i2").tobytes())
    clip = bm.split(walks)["ann-walk"]
    page = bm.view(clip, sound=tmp_path / "hum.wav", sound_start=1.0).write(tmp_path / "p.html")
    seen = play(page)
    seen.page.locator("#play").click()
    seen.page.wait_for_function("player.state().heard > 0.3")
    apart = seen.page.evaluate(
        "(() => { const s = player.state(); return s.heard - s.seconds; })()"
    )
    # Less than two frames.
    assert abs(apart) < 2 / 15
    assert not seen.errors
    assert not seen.requests


def test_what_asks_the_network_is_seen(see, tmp_path):
    """A control of the other tests: they would notice."""
    path = tmp_path / "bad.html"
    path.write_text("<img src='http://127.0.0.1:9/a.png'><script>nothing.there()</script>")
    seen = see(path)
    seen.page.wait_for_timeout(200)
    assert seen.requests == ["http://127.0.0.1:9/a.png"]
    assert any("nothing" in error for error in seen.errors)


def test_a_page_that_cannot_be_shown_says_why(forecast_page, see, tmp_path):
    broken = tmp_path / "broken.html"
    text = forecast_page.read_text()
    start = text.index('<script id="content"')
    end = text.index("</script>", start)
    broken.write_text(text[:start] + '<script id="content" type="application/json">' + text[end:])
    seen = see(broken)
    seen.page.wait_for_function("document.documentElement.dataset.ready")
    assert "Nothing can be shown" in seen.page.locator("#notice").inner_text()


def test_notebooks_show_it_in_a_frame(forecast_view, see, tmp_path):
    path = tmp_path / "notebook.html"
    path.write_text(f"<!doctype html><body>{forecast_view._repr_html_()}</body>")
    seen = see(path)
    frame = seen.page.frame_locator("iframe")
    frame.locator("html[data-ready=yes]").wait_for(state="attached")
    assert json.loads(frame.locator("#content").text_content())["tracks"][1]["context"] == 8
    assert strong(seen.picture("iframe")) > 1500
    assert not seen.errors
