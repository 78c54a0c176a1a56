"""What a page holds: numbers that come back, names, sizes, and what is refused."""

import json
import re
import zlib
from base64 import b64decode

import numpy as np
import pytest

import bayesmotion as bm
from bayesmotion.motion import make_markers, positions, skeleton_of
from bayesmotion.view import viewer
from bayesmotion.view.packing import QUANTUM, UNKNOWN, packed, quantum_for, whole


def unpacked(text, series, frames, columns):
    """Undo `packed`, as the page's script does."""
    planes = np.frombuffer(zlib.decompress(b64decode(text)), np.uint8).astype(np.int64)
    half = len(planes) // 2
    z = planes[:half] | (planes[half:] << 8)
    change = (z >> 1) ^ -(z & 1)
    along = change.reshape(series, columns, frames).cumsum(axis=2)
    return np.moveaxis(((along + 32768) % 65536) - 32768, 2, 1)


def content_of(page):
    """Return the numbers that a page holds."""
    (text,) = re.findall(r'type="application/json">(.*?)</script>', page.html, re.DOTALL)
    return json.loads(text)


def test_numbers_come_back_to_half_a_millimetre():
    random = np.random.default_rng(0)
    values = random.normal(size=(3, 40, 5)).cumsum(axis=1)
    values[1, 5:9, 2] = np.nan
    quantum = quantum_for(values)
    assert quantum == QUANTUM
    found = unpacked(packed(whole(values, quantum)), 3, 40, 5)
    assert np.array_equal(found == UNKNOWN, np.isnan(values))
    np.testing.assert_allclose(
        np.where(np.isnan(values), 0, quantum * found), np.nan_to_num(values), atol=QUANTUM / 2
    )


def test_far_places_are_told_more_coarsely():
    values = np.array([[[-4000.0], [4000.0]]])
    quantum = quantum_for(values)
    found = quantum * unpacked(packed(whole(values, quantum)), 1, 2, 1)
    np.testing.assert_allclose(found, values, atol=quantum)


def test_places_on_the_page_are_those_of_the_joints(walks):
    clip = bm.split(walks)["ann-walk"]
    (track,) = content_of(bm.view(clip))["tracks"]
    found = track["quantum"] * unpacked(track["where"], 1, track["frames"], 3 * 38)[0]
    where = positions(clip).values
    true = where - where[:1, :1] * [1, 0, 1]
    apart = found.reshape(true.shape) - true
    # The floor may be elsewhere; nothing else.
    assert np.ptp(apart[..., 1]) < 2 * QUANTUM
    assert np.abs(apart[..., [0, 2]]).max() < QUANTUM


def test_a_forecast_brings_its_draws_its_context_and_how_sure_it_is(future):
    (track,) = content_of(bm.view(future))["tracks"]
    assert (track["role"], track["context"], track["ghosts"]["count"]) == ("mean", 8, 12)
    n, joints = track["frames"], len(track["joints"])
    apart = unpacked(track["ghosts"]["where"], 12, n, 3 * joints)
    sd = track["quantum"] * unpacked(track["sd"], 1, n, joints)[0]
    # What was given is the same in all draws; what is forecast is not, and more and more so.
    assert not apart[:, :8].any()
    assert not sd[:8].any()
    assert sd[-1].mean() > 0.005
    drawn = track["quantum"] * apart.reshape(12, n, joints, 3)[:, -1]
    away = drawn - drawn.mean(axis=0)
    np.testing.assert_allclose(sd[-1], np.sqrt((away**2).sum(axis=(0, 2)) / 11), atol=3 * QUANTUM)
    assert content_of(bm.view(future))["messages"] == list(future.messages)


def test_a_forecast_is_seen_in_a_browser(future, walks, play, shot, tmp_path):
    clip = bm.split(walks)["ben-run"]
    seen = play(bm.view(future, truth=clip, names=["forecast"]).write(tmp_path / "f.html"))
    seen.run("player.seek(15)")
    shot(seen, "player")
    assert seen.state("draws") == 12
    seen.page.locator("#colour").select_option("uncertainty")
    shot(seen, "player-uncertainty")
    assert "mm" in seen.page.locator("#scale").inner_text()
    beside = play(bm.view(walks).write(tmp_path / "w.html"), scheme="dark")
    beside.run("player.seek(9)")
    shot(beside, "player-beside")
    assert not seen.errors + beside.errors


def test_a_forecast_begins_where_the_truth_does(future, walks):
    clip = bm.split(walks)["ben-run"]
    truth, mean = bm.view(future, truth=clip).scene.tracks
    # What was given is the same, wherever the forecast goes; what is forecast is not. (Joints that
    # never bend in training, as hands do, are not features, and no part of what is given.)
    legs = [mean.joints.index(name) for name in ("root", "lfemur", "ltibia", "lfoot", "rfoot")]
    apart = np.abs(mean.where - truth.where)[:, legs].max(axis=(1, 2))
    assert apart[:8].max() < 0.001
    assert apart[-1] > 0.02
    np.testing.assert_allclose(mean.ghosts.where[:, 0], mean.where[:1].repeat(12, 0), atol=1e-9)
    assert np.nanmin(truth.where[..., 1]) == pytest.approx(0.0, abs=0.05)


def test_what_other_tasks_and_predictions_say_is_seen(fit, walks):
    clip = bm.split(walks)["ann-walk"]
    clean = bm.view(bm.denoise(clip)).scene
    assert [(t.name, t.role) for t in clean.tracks] == [("given", "truth"), ("ann-walk", "mean")]
    assert clean.tracks[1].ghosts.sd.max() > 0
    assert clean.tracks[1].ghosts.where.size == 0
    made = bm.synthesize(fit, {"subject": "ann", "gait": "run"}, 1.0, samples=3)
    (track,) = bm.view(made).scene.tracks
    assert len(track.ghosts.where) == 3
    assert track.ghosts.sd is None
    assert [t.name for t in bm.view(fit).scene.tracks] == bm.clips(walks)[:3]


def test_marimo_shows_pages_and_figures(walks):
    """With `uv run --with marimo pytest tests/view -k marimo`; Jupyter: `test_notebooks`."""
    formatting = pytest.importorskip("marimo._output.formatting", reason="marimo is not installed")
    clip = bm.split(walks)["ann-walk"]
    page = formatting.try_format(bm.view(clip))
    assert (page.mimetype, page.traceback) == ("text/html", None)
    assert page.data.startswith("<iframe")
    figure = formatting.try_format(bm.stick_figures(clip).figure)
    assert "data:image/png;base64" in str(figure.data)


def test_markers_have_no_bones_and_may_be_missing():
    random = np.random.default_rng(1)
    where = random.normal(size=(20, 4, 3))
    where[3:6, 2] = np.nan
    markers = make_markers(list("abcd"), where, frame_rate=30.0, clip="m", metres=0.1)
    (track,) = bm.view(markers).scene.tracks
    assert track.bones.shape == (0, 2)
    assert np.isnan(track.where[3:6, 2]).all()
    # Between markers of one frame nothing but the unit is changed.
    np.testing.assert_allclose(
        track.where[7, 1] - track.where[7, 0], 0.1 * (where[7, 1] - where[7, 0])
    )


def test_filled_gaps_are_seen_with_how_sure_they_are(walks):
    clip = bm.split(walks)["ann-walk"]
    names, where = list(skeleton_of(clip).names), positions(clip).values * 1000.0
    where[6:9, 4] = np.nan
    markers = make_markers(names, where, frame_rate=15.0, clip="m", metres=0.001)
    filled = bm.fill_gaps(markers)
    given, whole = bm.view(filled).scene.tracks
    assert np.isnan(given.where[6:9, 4]).all()
    assert np.isfinite(whole.where).all()
    np.testing.assert_allclose(whole.ghosts.sd[7, 4], 3**0.5 * filled.sd[7, 4] / 1000.0)
    assert whole.ghosts.sd[7, 4] > 0.0
    assert not whole.ghosts.sd[:6].any()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_whatever_axis_is_up_bodies_stand(walks, axis, sign):
    clip = bm.split(walks)["ann-walk"]
    (track,) = bm.view(clip).scene.tracks
    where, names = track.where, list(track.joints)
    turned = where @ np.roll(np.diag([sign, sign, 1]), axis - 1, axis=1)
    markers = make_markers(names, turned, frame_rate=30.0, clip="m", metres=1.0)
    found = bm.view(markers).scene.tracks[0].where
    np.testing.assert_allclose(np.diff(found[..., 1], axis=1), np.diff(where[..., 1], axis=1))
    # It is turned, not mirrored: what four joints span keeps its sign and size.
    corners = [names.index(name) for name in ("rfemur", "lfemur", "head", "ltoes")]
    spans = [np.linalg.det(np.diff(one[:, corners], axis=1)) for one in (where, found)]
    np.testing.assert_allclose(*spans, atol=1e-9)
    assert np.abs(spans[0]).max() > 0.01


def test_files_are_seen_as_what_they_hold(fit, walks, tmp_path):
    clip = bm.split(walks)["ann-walk"]
    bm.write(clip, tmp_path / "walk.bvh")
    fit.save(tmp_path / "fit.nc")
    page = bm.view(tmp_path / "walk.bvh", tmp_path / "fit.nc", names=list("abcd"))
    assert [t.name for t in page.scene.tracks] == list("abcd")
    assert page.scene.arrangement == "beside"


def test_a_page_that_would_be_too_large_has_fewer_draws_and_says_so(future, monkeypatch):
    whole_page = bm.view(future)
    size = len(whole_page.html.encode()) / 1e6
    monkeypatch.setattr(viewer, "LARGEST", 0.95 * size)
    page = bm.view(future)
    (track,) = page.scene.tracks
    count = len(track.ghosts.where)
    assert 1 <= count < 12
    assert len(page.html.encode()) / 1e6 <= 0.95 * size
    assert f"{count} of 12 draws are on this page" in page.scene.messages[-1]


def test_names_cannot_break_the_page(walks):
    clip = bm.split(walks)["ann-walk"]
    bad = "</script><img src=x> {{script}}"
    page = bm.view(clip, names=[bad], title=bad)
    assert "<img" not in page.html
    assert content_of(page)["tracks"][0]["name"] == bad


def test_what_cannot_be_seen_is_refused(walks, tmp_path):
    clip = bm.split(walks)["ann-walk"]
    model, recordings = bm.example("mixture_ppca")
    points = bm.fit(model, recordings, seed=0)
    for call, told in (
        (lambda: bm.view(), "nothing to be seen"),
        (lambda: bm.view(clip, names=["a", "b"]), "2 for 1 bodies"),
        (lambda: bm.view(clip, draws=-1), "draws"),
        (lambda: bm.view(clip, arrangement="above"), "arrangement"),
        (lambda: bm.view(clip, sound="a.txt"), "do not play"),
        (lambda: bm.view(clip, sound=tmp_path / "a.wav"), "no such file"),
        (lambda: bm.view(points), "no bodies"),
        (lambda: bm.view(bm.predict(points, recordings)), "none of motions"),
    ):
        with pytest.raises(bm.InputError, match=told):
            call()
    other = tmp_path / "mine.html"
    other.write_text("<p>mine</p>")
    with pytest.raises(bm.InputError, match="holds no page"):
        bm.view(clip).write(other)
    assert other.read_text() == "<p>mine</p>"


def test_the_command_writes_a_page(walks, tmp_path, run, refused, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    clip = bm.split(walks)["ann-walk"]
    bm.write(clip, tmp_path / "walk.bvh")
    page = tmp_path / "p.html"
    assert "not known" in refused(run("view", tmp_path / "walk.txt", "--out", page))
    result = run("view", tmp_path / "walk.bvh", "--truth", tmp_path / "walk.bvh", "--out", page,
                 "--json", tmp_path / "p.json", "--open")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert json.loads((tmp_path / "p.json").read_text())["bodies"] == ["truth", "walk"]
    assert opened == [page.resolve().as_uri()]
    assert "arrangement" in refused(run("view", tmp_path / "walk.bvh", "--arrangement", "up"))
