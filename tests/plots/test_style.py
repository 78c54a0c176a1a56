"""Saving pictures, and what all have in common."""

import matplotlib
import numpy as np
import pytest
from PIL import Image

from bayesmotion.errors import InputError
from bayesmotion.plots import forecast_errors, phase_plot, save
from bayesmotion.plots.style import SERIES, marks, new_figure, plain


@pytest.fixture
def figure():
    figure = new_figure(3.0, 2.0)
    figure.subplots().plot([0, 1], [1, 0])
    return figure


def test_a_png_has_the_size_asked_for(figure, tmp_path):
    path = save(figure, tmp_path / "deep" / "a.png", dpi=100.0)
    with Image.open(path) as image:
        image.load()
        assert (image.format, image.size) == ("PNG", (300, 200))


@pytest.mark.parametrize(("name", "start"), [("a.pdf", b"%PDF"), ("a.SVG", b"<?xml")])
def test_the_suffix_decides(figure, tmp_path, name, start):
    assert save(figure, tmp_path / name).read_bytes().startswith(start)


@pytest.mark.parametrize("suffix", [".svg", ".pdf"])
def test_the_same_picture_is_the_same_file(tmp_path, suffix):
    made = []
    for name in "ab":
        figure = new_figure(3.0, 2.0)
        figure.subplots().plot([0.0, 1.0], "o-")
        made.append(save(figure, tmp_path / f"{name}{suffix}").read_bytes())
    assert made[0] == made[1]


def test_an_axes_stands_for_its_figure(figure, tmp_path):
    with Image.open(save(figure.axes[0], tmp_path / "a.png", dpi=50.0)) as image:
        assert image.size == (150, 100)


@pytest.mark.parametrize("name", ["a.xyz", "a", "a.gif"])
def test_unknown_suffixes_are_refused(figure, tmp_path, name):
    with pytest.raises(InputError, match=r"\.png, \.pdf, \.svg"):
        save(figure, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("dpi", [0.0, -1.0, np.nan])
def test_dpi_is_positive(figure, tmp_path, dpi):
    with pytest.raises(InputError, match="dpi"):
        save(figure, tmp_path / "a.png", dpi=dpi)


def test_the_old_picture_survives_a_failure(figure, tmp_path, monkeypatch):
    path = save(figure, tmp_path / "a.png")
    old = path.read_bytes()

    def fail(temporary, **_):
        temporary.write_bytes(b"half a pic")
        raise OSError("disk full")

    monkeypatch.setattr(figure, "savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        save(figure, path)
    assert path.read_bytes() == old
    assert list(tmp_path.iterdir()) == [path]


def test_names_are_written_as_they_are(tmp_path):
    times = np.arange(3.0)
    name = r"_cost $\frac$"
    ax = forecast_errors(times, {name: times})
    assert ax.get_legend().get_texts()[0].get_text() == plain(name)
    save(ax, tmp_path / "a.png")


def test_marks_differ():
    assert len(set(marks(49))) == 49
    assert [colour for colour, _ in marks(7)] == list(SERIES)
    assert len(marks(60)) == 60


def test_nothing_global_is_touched(tmp_path):
    before = dict(matplotlib.rcParams)
    save(phase_plot(np.arange(3.0), np.arange(3.0), ["a"] * 3), tmp_path / "a.png")
    assert dict(matplotlib.rcParams) == before
    pyplot = pytest.importorskip("matplotlib.pyplot")
    assert pyplot.get_fignums() == []
