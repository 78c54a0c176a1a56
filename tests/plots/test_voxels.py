"""Pictures of voxels and angles: what is drawn where."""

import numpy as np

from bayesmotion.plots.voxels import angle_figure, descriptor_figure, voxel_figure


def test_every_set_of_voxels_has_its_panel():
    cube = np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3)
    figure = voxel_figure([cube, cube[:10], cube * [1, 3, 1]], ["a", "b", "c$"], columns=2)
    assert [ax.get_title() for ax in figure.axes] == ["a", "b", r"c\$"]
    counts = [len(ax.collections[0].get_offsets()) for ax in figure.axes]
    assert counts == [64, 10, 64]
    # A tall body is drawn tall.
    low, high = (np.ptp(figure.axes[i].collections[0].get_offsets()[:, 1]) for i in (0, 2))
    assert high > 2 * low


def test_shells_of_a_descriptor_share_their_shades():
    values = np.arange(24.0).reshape(2, 3, 4)
    figure = descriptor_figure(values, "one")
    first, second = (ax.images[0] for ax in figure.axes)
    np.testing.assert_array_equal(first.get_array(), values[0])
    assert first.get_clim() == second.get_clim() == (0.0, 23.0)


def test_estimates_are_drawn_in_the_turn_of_the_truth():
    true = np.linspace(0.0, 7.0, 12)[:, None]
    found = (true + 0.1) % (2 * np.pi)
    figure = angle_figure(true, found, np.full_like(true, 0.05), ["root/heading"])
    (ax,) = figure.axes
    estimate, line = ax.lines
    np.testing.assert_allclose(line.get_ydata(), np.degrees(true[:, 0]))
    np.testing.assert_allclose(estimate.get_ydata() - line.get_ydata(), np.degrees(0.1))
