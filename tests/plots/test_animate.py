"""Moving pictures: how many, how long, what is in them."""

import numpy as np
import pytest
from PIL import Image

from bayesmotion.errors import InputError
from bayesmotion.plots import animate
from bayesmotion.plots.animate import _pictures, _Scene
from bayesmotion.plots.bodies import body_of


def test_a_gif_plays_at_true_speed(walk, tmp_path):
    path = animate(walk, tmp_path / "a.gif", max_pictures=5, dpi=50.0)
    with Image.open(path) as image:
        assert (image.format, image.size, image.n_frames) == ("GIF", (120, 130), 5)
        assert image.n_frames * image.info["duration"] == 1000
        first = np.asarray(image.convert("RGB"))
        image.seek(2)
        assert (np.asarray(image.convert("RGB")) != first).any()


def test_html_holds_its_pictures(walk, tmp_path):
    path = animate(walk, tmp_path / "a.html", max_pictures=3, dpi=50.0)
    text = path.read_text()
    assert text.count("data:image/png;base64") == 3
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("length", "rate"), [(30, 30.0), (1200, 120.0), (9000, 30.0), (2, 30.0)])
def test_pictures_are_bounded_and_true_to_time(length, rate):
    frames, lasting = _pictures(length, rate, 150)
    assert len(frames) <= 150
    assert lasting >= 4
    assert len(frames) * lasting / 100 == pytest.approx(length / rate, abs=lasting / 100)
    np.testing.assert_allclose(
        frames / rate, np.arange(len(frames)) * lasting / 100, atol=0.5001 / rate
    )
    assert (np.diff(frames) > 0).all()
    assert frames[-1] < length


def test_overlaid_bodies_start_in_one_place(walk):
    moved = walk.assign(root_position=walk["root_position"] + [3.0, 0.0, 5.0])
    first = body_of(walk)
    scene = _Scene([first, body_of(moved, beside=first)], ("forecast", "truth"), "overlaid", 10)
    np.testing.assert_allclose(scene.bodies[0].points, scene.bodies[1].points, atol=1e-9)
    assert len(scene.axes) == 1
    assert scene.axes[0].get_title() == "forecast"
    assert [text.get_text() for text in scene.figure.legends[0].get_texts()][-1] == "truth"
    scene.show(9)
    assert scene.clock.get_text() == "0.30 s · given"
    scene.show(10)
    assert scene.clock.get_text() == "0.33 s · forecast"


def test_the_shorter_one_disappears(walk):
    bodies = [body_of(walk), body_of(walk.isel(frame=slice(10)))]
    scene = _Scene(bodies, ("a", "b"), "beside", None)
    drawn = []
    for frame in (9, 10):
        scene.show(frame)
        drawn.append([len(ax.patches) for ax in scene.axes])
    assert drawn == [[1, 1], [1, 0]]


def test_the_body_stays_in_the_picture(walkers):
    body = body_of(walkers["ann-run"])
    scene = _Scene([body], ("", ""), "overlaid", None)
    for frame in range(0, 30, 5):
        scene.show(frame)
        (left, right), (bottom, top) = scene.axes[0].get_xlim(), scene.axes[0].get_ylim()
        x, y = body.points[frame].T
        assert left < x.min() < x.max() < right
        assert bottom < y.min() < y.max() < top


def test_what_cannot_be_animated(walk, tmp_path):
    path = tmp_path / "a.gif"
    path.write_bytes(b"old")
    slow = walk.assign_attrs(frame_rate=15.0)
    for settings, match in (
        ({"max_pictures": 0}, "at least one"),
        ({"dpi": 5000.0}, "dpi"),
        ({"other": slow}, "15 frames a second"),
    ):
        with pytest.raises(InputError, match=match):
            animate(walk, path, **settings)
    with pytest.raises(InputError, match=r"\.gif, \.html"):
        animate(walk, tmp_path / "a.mp4")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_old_animation_survives_a_failure(walk, tmp_path, monkeypatch):
    path = tmp_path / "a.gif"
    path.write_bytes(b"old")
    calls = []

    def fail(self, frame):
        calls.append(frame)
        if len(calls) > 3:
            raise RuntimeError("no more")

    monkeypatch.setattr(_Scene, "show", fail)
    with pytest.raises(RuntimeError, match="no more"):
        animate(walk, path, dpi=20.0)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
