"""Latent points in three dimensions, by what they belong to, and how sure they are."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ..errors import InputError
from . import style

_MOST_DRAWS, _MOST_NAMES = 40, 12


def latent_space(
    draws: Float[np.ndarray, "draw n q"],
    labels: Mapping[str, Sequence[str] | np.ndarray],
    *,
    paths: Sequence[str] | np.ndarray | None = None,
    figure: Figure | None = None,
) -> Figure:
    """Draw latent points, a panel for each of their labels, coloured by it.

    More than three dimensions are shown along the three principal axes of the means. Around
    the means are the draws, as faint dots: the volume they fill is how sure the points are.

    Parameters
    ----------
    draws
        Latent points, brought together over draws (`bm.aligned`); at least two dimensions.
    labels
        By title, the label of every point, such as its clip, subject or gait.
    paths
        (N,) which points are joined by lines, in their order; none where None.
    figure
        An empty Figure to draw in; a new one if None.

    Raises
    ------
    InputError
        If there are no labels, one dimension, or a point that is not finite.
    """
    if not labels or draws.shape[2] < 2 or not np.isfinite(draws).all():
        raise InputError(
            "latent points", f"their shape is {draws.shape}, with {len(labels)} labels",
            "Give finite points of two dimensions or more, and a label",
        )  # fmt: skip
    mean = draws.mean(axis=0)
    axes = np.eye(draws.shape[2])
    if draws.shape[2] > 3:
        axes = np.linalg.svd(mean - mean.mean(axis=0), full_matrices=False)[2][:3].T
    shown = [one @ axes for one in draws[:: -(-len(draws) // _MOST_DRAWS)]]
    points, three = mean @ axes, axes.shape[1] == 3
    if figure is None:
        figure = style.new_figure(style.WIDTH, 3.1)
    for place, (title, names) in enumerate(labels.items()):
        kind = {"projection": "3d"} if three else {}
        ax = figure.add_subplot(1, len(labels), place + 1, **kind)
        _panel(ax, points, shown if len(draws) > 1 else [], np.asarray(names), paths)
        ax.set_title(style.plain(title), fontsize=style.TITLE, color=style.INK)
        ax.tick_params(labelsize=style.SMALL - 1.0)
        if three:
            ax.set_box_aspect(tuple(np.ptp(points, axis=0) + 1e-9))  # pyright: ignore[reportArgumentType]
            # More ticks run into each other where an axis is short, or seen nearly along.
            for axis in (ax.xaxis, ax.yaxis, ax.zaxis):  # pyright: ignore[reportAttributeAccessIssue]
                axis.set_major_locator(MaxNLocator(3))
        else:
            ax.set_aspect("equal", adjustable="datalim")
    return figure


def _panel(
    ax: object, points: np.ndarray, draws: Sequence[np.ndarray], names: np.ndarray,
    paths: Sequence[str] | np.ndarray | None,
) -> None:  # fmt: skip
    """Draw one panel."""
    levels = list(dict.fromkeys(names.tolist()))
    handles = []
    for level, (colour, marker) in zip(levels, style.marks(len(levels)), strict=True):
        own = names == level
        for one in draws:
            ax.plot(*one[own].T, ".", color=colour, markersize=1.2, alpha=0.25)  # pyright: ignore[reportAttributeAccessIssue]
        look = {"color": colour, "marker": marker, "markersize": 3.0, "linewidth": 0.8}
        if paths is None:
            ax.plot(*points[own].T, linestyle="none", **look)  # pyright: ignore[reportAttributeAccessIssue]
        else:
            for path in dict.fromkeys(np.asarray(paths)[own].tolist()):
                rows = own & (np.asarray(paths) == path)
                ax.plot(*points[rows].T, **look)  # pyright: ignore[reportAttributeAccessIssue]
        handles.append(Line2D([], [], color=colour, marker=marker, markersize=3.0, lw=0.8))
    more = [f"and {len(levels) - _MOST_NAMES} more"] if len(levels) > _MOST_NAMES else []
    shown = [str(level) or "unknown" for level in levels[:_MOST_NAMES]] + more
    blank = [Line2D([], [], linestyle="none")] * len(more)
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.06), "ncols": 2}
    style.key(ax, [*handles[:_MOST_NAMES], *blank], shown, **where)  # pyright: ignore[reportArgumentType]
