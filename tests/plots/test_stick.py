"""Strips, comparisons and grids: what stands on the paper."""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.patches import Circle
from PIL import Image

from bayesmotion.errors import InputError
from bayesmotion.plots import compare, grid, save, stick_figures
from bayesmotion.plots.bodies import body_of
from bayesmotion.plots.strips import strip_of
from bayesmotion.plots.style import GREEN, PALE, SIDES, new_figure

BONES = 34


def figures(ax):
    return [one for one in ax.collections if isinstance(one, LineCollection)]


def segments(ax):
    return sum(len(one.get_segments()) for one in figures(ax))


def texts(ax):
    return [text.get_text() for text in ax.texts]


def floor(ax):
    (line,) = [line for line in ax.lines if line.get_label() == "floor"]
    return line


def across(one):
    """Give the leftmost and rightmost point of a figure."""
    points = np.concatenate(one.get_segments())
    return points[:, 0].min(), points[:, 0].max()


def test_every_bone_of_every_figure_is_drawn(walk):
    ax = stick_figures(walk, count=5)
    assert len(figures(ax)) == 5
    assert segments(ax) == 5 * BONES
    assert len([patch for patch in ax.patches if isinstance(patch, Circle)]) == 5


def test_limbs_have_the_colour_of_their_side(walk):
    ax = stick_figures(walk, count=1)
    drawn = [to_hex(colour, keep_alpha=False).upper() for colour in figures(ax)[0].get_colors()]
    wanted = [SIDES[side] for side in body_of(walk).sides]
    assert sorted(drawn) == sorted(wanted)
    shown = [text.get_text() for text in ax.get_legend().get_texts()]
    assert shown == ["left", "right"]
    assert stick_figures(walk, legend=False).get_legend() is None


def test_what_is_nearer_lies_over_what_is_farther(walk):
    colours = [to_hex(colour).upper() for colour in figures(stick_figures(walk))[0].get_colors()]
    order = {side: [i for i, c in enumerate(colours) if c == SIDES[side]] for side in SIDES}
    assert np.mean(order["left"]) < np.mean(order["centre"]) < np.mean(order["right"])


def test_figures_stand_on_the_floor_inside_the_picture(walk):
    ax = stick_figures(walk, count=6)
    left, right = ax.get_xlim()
    assert floor(ax).get_ydata().tolist() == [0, 0]
    assert floor(ax).get_xdata().tolist() == [left, right]
    points = np.concatenate([np.concatenate(one.get_segments()) for one in figures(ax)])
    assert left < points[:, 0].min() < points[:, 0].max() < right
    assert ax.get_ylim()[0] < points[:, 1].min() < 0.05
    assert points[:, 1].max() < ax.get_ylim()[1]


@pytest.mark.parametrize("travel", [True, False])
@pytest.mark.parametrize("view", ["side", "front", "three_quarter"])
def test_figures_do_not_touch(walkers, travel, view):
    body = body_of(walkers["ben-run"], view)
    strip = strip_of(body, np.arange(0, 30, 3), travel=travel)
    joints = body.points[strip.frames] + np.stack([strip.shift, 0 * strip.shift], -1)[:, None]
    dense = [
        np.concatenate([a + t * (b - a) for t in np.linspace(0, 1, 7)])
        for a, b in zip(joints[:, body.bones[:, 0]], joints[:, body.bones[:, 1]], strict=True)
    ]
    for one, other in pairwise(dense):
        assert np.linalg.norm(one[:, None] - other[None], axis=-1).min() > 0.03


def test_travel_keeps_distances_and_its_lack_makes_them_equal(walkers):
    body = body_of(walkers["ann-run"])
    frames = np.array([0, 15, 20])
    places = body.points[frames, 0, 0]
    gone = np.diff(places + strip_of(body, frames, travel=True).shift)
    assert gone[0] == pytest.approx(places[1] - places[0])  # half a second of running: far apart
    same = np.diff(places + strip_of(body, frames, travel=False).shift)
    assert same[0] == pytest.approx(same[1])


def test_frames_and_times(walk):
    ax = stick_figures(walk, frames=[0, 10, 29])
    assert texts(ax) == ["0.00 s", "0.33", "0.97"]
    assert texts(stick_figures(walk, times=False)) == []
    assert len(figures(stick_figures(walk, count=100))) == 30


def test_times_that_would_overlap_are_left_out(walk):
    ax = stick_figures(walk, count=30)
    assert 1 < len(texts(ax)) < 30
    figure = ax.get_figure()
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in ax.texts]
    assert all(one.x1 < other.x0 for one, other in pairwise(boxes))


def test_given_axes_are_used(walk):
    axes = new_figure(6.0, 3.0).subplots(1, 2)
    assert stick_figures(walk, ax=axes[1]) is axes[1]
    assert segments(axes[1]) == 8 * BONES
    assert not figures(axes[0])


def test_a_limb_not_known_is_left_out(walk):
    angle = walk["angle"].copy()
    angle.loc[{"dof": "lradius/rx", "frame": walk["frame"][:10]}] = np.nan
    ax = stick_figures(walk.assign(angle=angle), frames=[0, 29])
    whole = [sum(len(ends) == 2 for ends in one.get_segments()) for one in figures(ax)]
    assert whole[0] < whole[1] == BONES
    assert np.isfinite([*ax.get_xlim(), *ax.get_ylim()]).all()


def test_compare_has_labelled_rows_of_one_scale(walk, bvh_like, tmp_path):
    figure = compare({"truth": walk, "a big body": bvh_like}, count=6)
    assert [ax.get_ylabel() for ax in figure.axes] == ["truth", "a big body"]
    assert [segments(ax) for ax in figure.axes] == [6 * BONES] * 2
    spans = [(*np.diff(ax.get_xlim()), *ax.get_ylim()) for ax in figure.axes]
    np.testing.assert_allclose(spans[0], spans[1])
    # The same frames: one over the other, and the times once.
    middles = [[np.mean(across(one)) for one in figures(ax)] for ax in figure.axes]
    np.testing.assert_allclose(np.diff(middles[0]), np.diff(middles[1]), atol=0.05)
    assert [len(ax.texts) for ax in figure.axes] == [0, 6]
    with Image.open(save(figure, tmp_path / "a.png", dpi=50.0)) as image:
        assert image.size == tuple((figure.get_size_inches() * 50).astype(int))


def test_rows_of_unlike_clips_keep_step(walkers):
    figure = compare({"walk": walkers["ann-walk"], "run": walkers["ann-run"]}, count=5)
    steps = [
        np.mean(np.diff([patch.center[0] for patch in ax.patches if isinstance(patch, Circle)]))
        for ax in figure.axes
    ]
    assert steps[0] == pytest.approx(steps[1], rel=0.03)


def test_a_grid_shows_about_one_cycle(walk):
    cells = {("ann", "walk"): walk}
    poses = {}
    for seconds in (0.5, None):
        (ax,) = grid(cells, count=3, seconds=seconds).axes
        poses[seconds] = [_pose(one) for one in figures(ax)]
    assert not np.allclose(poses[0.5][2], poses[None][2])
    wanted = figures(stick_figures(walk.isel(frame=slice(16)), count=3))
    np.testing.assert_allclose(poses[0.5], [_pose(one) for one in wanted])
    with pytest.raises(InputError, match="seconds"):
        grid(cells, seconds=0.0)


def test_compare_writes_times_in_every_row_where_they_differ(walk):
    figure = compare({"all": walk, "half": walk.isel(frame=slice(15))}, count=3)
    assert [len(ax.texts) for ax in figure.axes] == [3, 3]


def test_grid_frames_what_was_inferred(walkers):
    cells = {tuple(name.split("-")): motion for name, motion in walkers.items()}
    del cells["ben", "run"]
    figure = grid(cells, {("ann", "run")}, rows_label="person", columns_label="gait", count=3)
    titles, labels = ([f(ax) for ax in figure.axes] for f in (_title, _label))
    assert titles == ["walk", "run", "", ""]
    assert labels == ["ann", "", "ben", ""]
    assert (figure.get_suptitle(), figure.get_supylabel()) == ("gait", "person")
    assert [segments(ax) for ax in figure.axes] == [3 * BONES] * 3 + [0]
    framed = [all(spine.get_visible() for spine in ax.spines.values()) for ax in figure.axes]
    assert framed == [False, True, False, False]
    inferred = figure.axes[1]
    assert inferred.get_facecolor() == to_rgba(PALE)
    assert inferred.spines["top"].get_edgecolor() == to_rgba(GREEN)
    assert texts(figure.axes[3]) == ["not recorded"]
    shown = [text.get_text() for text in figure.legends[0].get_texts()]
    assert shown == ["left", "right", "inferred by the model"]
    assert len(grid(cells, count=1).legends[0].get_texts()) == 2


def test_words_do_not_overlap(walkers):
    cells = {tuple(name.split("-")): motion for name, motion in walkers.items()}
    figure = grid(cells, {("ann", "run")})
    figure.draw_without_rendering()
    words = [figure.legends[0], *figure.texts, *(ax.title for ax in figure.axes[:2])]
    words += [figure.axes[0].yaxis.label, figure.axes[2].yaxis.label]
    boxes = [word.get_window_extent() for word in words]
    boxes += [ax.get_window_extent() for ax in figure.axes]
    page = figure.bbox
    for i, one in enumerate(boxes):
        assert page.x0 <= one.x0 < one.x1 <= page.x1
        assert page.y0 <= one.y0 < one.y1 <= page.y1
        assert not any(one.overlaps(other) for other in boxes[i + 1 :])


def test_settings_that_cannot_be_used(walk):
    with pytest.raises(InputError, match="at least one figure"):
        stick_figures(walk, count=0)
    for frames in ([], [30], [-1]):
        with pytest.raises(InputError, match="from 0 to 29"):
            stick_figures(walk, frames=frames)
    with pytest.raises(InputError, match="motions"):
        compare({})
    with pytest.raises(InputError, match="cells"):
        grid({})
    with pytest.raises(InputError, match="no motion of it"):
        grid({("ann", "walk"): walk}, {("ann", "run")})


def _pose(one):
    points = np.array(one.get_segments())
    return points - points[:1, :1]


def _title(ax):
    return ax.get_title()


def _label(ax):
    return ax.get_ylabel()
