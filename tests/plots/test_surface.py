"""Pictures of latent surfaces."""

import numpy as np
import pytest

from bayesmotion.distributions.topology import Surface
from bayesmotion.errors import InputError
from bayesmotion.plots import confidence, save, surfaces

SURFACE = Surface("torus", 8, 4, (0.5, 1.0))


def test_every_cycle_is_a_closed_line_in_its_layers_colour(tmp_path):
    t = SURFACE.points()
    figure = surfaces({"ideal": t, "moved": t + 0.1}, SURFACE.index(), ["short", "long"])
    for ax, x in zip(figure.axes, (t, t + 0.1), strict=True):
        assert len(ax.lines) == 8
        drawn = np.stack(ax.lines[1].get_data_3d(), axis=1)  # pyright: ignore
        np.testing.assert_allclose(drawn[:-1], x.reshape(2, 4, 8, 3)[0, 1])
        np.testing.assert_allclose(drawn[-1], drawn[0])
        assert ax.lines[0].get_color() != ax.lines[4].get_color()
    save(figure, tmp_path / "a.png", dpi=40.0)
    with pytest.raises(InputError, match="Name every layer"):
        surfaces({"ideal": t}, SURFACE.index(), ["one"])


def test_maps_of_confidence_share_one_scale(tmp_path):
    maps = {"a": np.arange(12.0).reshape(3, 4), "b": np.ones((3, 4))}
    points = {name: np.zeros((2, 2)) for name in maps}
    figure = confidence(maps, points, dict.fromkeys(maps, (-1.0, 1.0, -1.0, 1.0)))
    images = [ax.images[0] for ax in figure.axes if ax.images]
    assert [image.get_clim() for image in images] == [(0.0, 11.0)] * 2
    np.testing.assert_array_equal(images[0].get_array(), maps["a"])
    save(figure, tmp_path / "b.png", dpi=40.0)
