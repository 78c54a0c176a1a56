"""Latent surfaces of gait-pose models: their layers, and where the model is sure."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..errors import InputError
from . import style


def surfaces(
    points: Mapping[str, Float[np.ndarray, "n 3"]],
    index: Int[np.ndarray, "n 3"],
    layers: Sequence[str],
) -> Figure:
    """Draw surfaces side by side in three dimensions, one line a cycle, one colour a layer.

    Parameters
    ----------
    points
        By title, for example before and after learning.
    index
        (N, 3) layer, gait and pose of every point.
    layers
        What each layer is called.

    Raises
    ------
    InputError
        If points are not three numbers each, or layers are not named.
    """
    if len(layers) != index[:, 0].max() + 1:
        raise InputError("layers", f"{len(layers)} names", "Name every layer")
    figure = style.new_figure(style.WIDTH, 3.4)
    colours = style.SERIES[: len(layers)]
    for place, (title, x) in enumerate(points.items()):
        if x.shape != (len(index), 3):
            raise InputError("points", f"their shape is {x.shape}", f"Give {len(index)} times 3")
        ax = figure.add_subplot(1, len(points), place + 1, projection="3d")
        for layer, colour in enumerate(colours):
            for gait in range(index[:, 1].max() + 1):
                path = x[(index[:, 0] == layer) & (index[:, 1] == gait)]
                closed = np.concatenate([path, path[:1]])
                ax.plot(*closed.T, color=colour, linewidth=style.HAIR)
        ax.set_title(style.plain(title), fontsize=style.TITLE, color=style.INK)
        ax.set_box_aspect(tuple(np.ptp(x, axis=0) + 1e-9))  # pyright: ignore[reportArgumentType]
        ax.tick_params(labelsize=style.SMALL - 1.0)
    handles = [Line2D([], [], color=colour) for colour in colours]
    style.key(figure, handles, layers, loc="outside lower center", ncols=len(layers))
    return figure


def confidence(
    maps: Mapping[str, Float[np.ndarray, "rows columns"]],
    points: Mapping[str, Float[np.ndarray, "n 2"]],
    extent: Mapping[str, tuple[float, float, float, float]],
) -> Figure:
    """Draw how sure models are along a cut through their latent spaces.

    Parameters
    ----------
    maps
        By title, the logarithm of the precision of a feature on a grid, rows upwards.
    points
        Training points near the cut.
    extent
        Left, right, lower and upper edge of each grid.
    """
    figure = style.new_figure(style.WIDTH, 2.8)
    axes = figure.subplots(1, len(maps), squeeze=False)[0]
    low = min(float(grid.min()) for grid in maps.values())
    high = max(float(grid.max()) for grid in maps.values())
    image = None
    for ax, (title, grid) in zip(axes, maps.items(), strict=True):
        image = ax.imshow(
            grid, origin="lower", extent=extent[title], cmap="inferno", vmin=low, vmax=high
        )
        ax.plot(*points[title].T, ".", color="white", markersize=1.0)
        ax.set_title(style.plain(title), fontsize=style.TITLE, color=style.INK)
        style.tidy(ax)
    assert image is not None
    bar = figure.colorbar(image, ax=list(axes), shrink=0.8)
    bar.set_label("log precision", fontsize=style.LABEL, color=style.INK)
    bar.ax.tick_params(labelsize=style.SMALL)
    return figure
