"""Forecast curves and errors."""

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from bayesmotion.errors import InputError
from bayesmotion.plots import forecast_errors, forecast_plot, save

TIMES = np.arange(40) / 30
MEAN = 50.0 * np.stack([0.5 * np.sin(4 * TIMES), np.cos(4 * TIMES)], axis=1)
SD = 3.0 + 5.0 * np.stack([TIMES, TIMES], axis=1)
BAND = (MEAN - SD, MEAN + 2.0 * SD)
TRUTH = MEAN + 1.0
LABELS = ["left hip", "left knee"]


def curve(ax, label):
    return next(line for line in ax.lines if line.get_label() == label)


def test_curves_and_band_are_those_given_under_their_title(tmp_path):
    figure = forecast_plot(TIMES, TRUTH, MEAN, BAND, 15, LABELS, title="walk: error $2")
    assert [ax.get_title(loc="left") for ax in figure.axes] == LABELS
    assert figure.get_suptitle() == r"walk: error \$2"
    for i, ax in enumerate(figure.axes):
        np.testing.assert_allclose(curve(ax, "median").get_ydata(), MEAN[:, i])
        np.testing.assert_allclose(curve(ax, "truth").get_ydata(), TRUTH[:, i])
        (band,) = [one for one in ax.collections if one.get_label() == "band"]
        edge = [y for x, y in band.get_paths()[0].vertices if x == TIMES[-1]]
        assert (min(edge), max(edge)) == pytest.approx([side[-1, i] for side in BAND])
    shown = [text.get_text() for text in figure.legends[0].get_texts()]
    assert shown == ["truth", "predictive median", "90% band", "given frames"]
    save(figure, tmp_path / "a.png", dpi=40.0)


def test_the_level_is_told():
    figure = forecast_plot(TIMES, None, MEAN, BAND, 0, LABELS, level=0.5)
    assert "50% band" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_given_frames_are_shaded():
    figure = forecast_plot(TIMES, None, MEAN, None, 15, LABELS)
    for ax in figure.axes:
        (shade,) = [patch for patch in ax.patches if patch.get_label() == "given"]
        assert shade.get_x() == TIMES[0]
        assert shade.get_x() + shade.get_width() == pytest.approx((TIMES[14] + TIMES[15]) / 2)
        assert not ax.collections
    bare = forecast_plot(TIMES, None, MEAN, None, 0, LABELS)
    assert not any(ax.patches for ax in bare.axes)
    assert [text.get_text() for text in bare.legends[0].get_texts()] == ["predictive median"]


def test_errors_of_all_are_drawn_the_model_strongest():
    errors = {"model": TIMES, "last pose": np.where(TIMES > 0.5, 2 * TIMES, np.nan)}
    ax = forecast_errors(TIMES, errors, 15, unit="degrees")
    model, other = [line for line in ax.lines if len(line.get_xdata()) == 40]
    np.testing.assert_array_equal(model.get_ydata(), TIMES)
    assert model.get_linewidth() > other.get_linewidth()
    assert to_rgba(model.get_color()) != to_rgba(other.get_color())
    assert ax.get_ylabel() == "error (degrees)"
    assert ax.get_ylim()[0] == 0
    shown = [text.get_text() for text in ax.get_legend().get_texts()]
    assert shown == ["model", "last pose", "given frames"]


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"truth": TRUTH[:-1]}, "truth"),
        ({"band": (MEAN[:, :1], MEAN[:, :1])}, "band"),
        ({"labels": LABELS[:1]}, "1 labels"),
        ({"labels": []}, "at least one angle"),
        ({"given": 41}, "0 to 40"),
        ({"times": TIMES[::-1]}, "rise"),
        ({"level": 1.0}, "level"),
    ],
)
def test_what_does_not_fit_is_refused(changes, match):
    good = {"times": TIMES, "truth": TRUTH, "middle": MEAN, "band": BAND, "given": 15}
    good |= {"labels": LABELS}
    with pytest.raises(InputError, match=match):
        forecast_plot(**(good | changes))


def test_errors_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="none"):
        forecast_errors(TIMES, {})
    with pytest.raises(InputError, match="short"):
        forecast_errors(TIMES, {"short": TIMES[:-1]})
