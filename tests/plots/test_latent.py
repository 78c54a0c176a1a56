"""Latent paths, phases and style vectors."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.plots import content_path, phase_plot, save, styles

CLIPS = ["a"] * 20 + ["b"] * 30
PHASE = np.concatenate([0.3 * np.arange(20), 1.0 + 0.2 * np.arange(30)])
CIRCLE = np.stack([np.cos(PHASE), np.sin(PHASE)], axis=1)
CUBE = np.column_stack([CIRCLE * 1.3, 0.2 * np.sin(2 * PHASE)])


def paths(ax):
    return [line.get_xydata() for line in ax.lines if len(line.get_xdata()) > 2]


def starts(ax):
    return [line.get_xydata()[0] for line in ax.lines if len(line.get_xdata()) == 1]


def test_three_dimensions_make_three_panels_of_one_box(tmp_path):
    figure = content_path(CUBE, CLIPS)
    for ax, (i, j) in zip(figure.axes, [(0, 1), (0, 2), (1, 2)], strict=True):
        assert (ax.get_xlabel(), ax.get_ylabel()) == (f"latent {i + 1}", f"latent {j + 1}")
        np.testing.assert_array_equal(paths(ax)[0], CUBE[:20, [i, j]])
        np.testing.assert_array_equal(paths(ax)[1], CUBE[20:, [i, j]])
        np.testing.assert_array_equal(starts(ax), CUBE[[0, 20]][:, [i, j]])
        assert ax.get_xlim() == ax.get_ylim() == figure.axes[0].get_xlim()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b"]
    save(figure, tmp_path / "a.png", dpi=40.0)


def test_clips_on_a_circle_get_rings():
    (ax,) = content_path(CIRCLE, CLIPS).axes
    radii = [np.hypot(*path.T) for path in paths(ax)]
    np.testing.assert_allclose(radii[0], 1.0)
    np.testing.assert_allclose(radii[1], radii[1][0])
    assert radii[1][0] > 1.05
    assert "ring" in ax.get_title()
    # Points near a circle only are left where they are.
    (ax,) = content_path(1.2 * CIRCLE, CLIPS).axes
    np.testing.assert_allclose(np.concatenate(paths(ax)), 1.2 * CIRCLE)


def test_phases_are_cycles_with_the_cadence_in_the_key():
    times = np.concatenate([np.arange(20), np.arange(30)]) / 30
    for phase in (PHASE, PHASE % (2 * np.pi), PHASE - 20 * np.pi):
        ax = phase_plot(times, phase, CLIPS)
        for line, own in zip(ax.lines, (PHASE[:20], PHASE[20:]), strict=True):
            np.testing.assert_allclose(line.get_ydata(), own / (2 * np.pi), atol=1e-9)
        shown = [text.get_text() for text in ax.get_legend().get_texts()]
        assert shown == ["a (1.43 cycles/s)", "b (0.95 cycles/s)"]


def test_styles_do_not_depend_on_the_rotation():
    vectors = np.array([[1.0, 0.2, 0.1], [0.3, 1.1, -0.2], [0.8, 0.5, 0.4]])
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    seen = []
    for own in (vectors, vectors @ turn):
        plane, table = styles(own, ["02", "08", "35"], title="subject").axes
        seen.append(
            (
                np.array(
                    [line.get_xydata()[0] for line in plane.lines if len(line.get_xdata()) == 1]
                ),
                table.images[0].get_array(),
                [text.get_text() for text in table.texts],
            )
        )
        assert [label.get_text() for label in table.get_yticklabels()] == ["02", "08", "35"]
    np.testing.assert_allclose(seen[0][1], vectors @ vectors.T)
    np.testing.assert_allclose(seen[0][1], seen[1][1])
    np.testing.assert_allclose(seen[0][0], seen[1][0], atol=1e-9)
    assert seen[0][2] == seen[1][2] == [f"{value:.2f}" for value in (vectors @ vectors.T).ravel()]


@pytest.mark.parametrize("shape", [(1, 1), (2, 1), (12, 5)])
def test_styles_of_any_size(shape, tmp_path):
    vectors = np.random.default_rng(1).standard_normal(shape)
    figure = styles(vectors, [str(i) for i in range(shape[0])])
    assert bool(figure.axes[1].texts) == (shape[0] <= 8)
    save(figure, tmp_path / "a.png", dpi=40.0)


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(InputError, match="two or three columns"):
        content_path(np.zeros((3, 4)), ["a"] * 3)
    with pytest.raises(InputError, match="50 for 49"):
        content_path(CIRCLE, CLIPS[:-1])
    with pytest.raises(InputError, match="row 1"):
        styles(np.array([[1.0], [np.nan]]), ["a", "b"])
    with pytest.raises(InputError, match="times"):
        phase_plot(np.arange(3.0), np.arange(2.0), ["a", "b"])
