"""Ranks of a calibration: how far their ECDF strays from that of uniform ones."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from ..evaluate.sbc.rank_test import LEVEL, levels_of, rank_test, ranks_of
from ..evaluate.sbc.uniformity import band, ecdf
from . import style

_COLUMNS, _HEIGHT = 4, 1.25


def rank_ecdfs(tree: xr.DataTree, *, figure: Figure | None = None) -> Figure:
    """Draw for every quantity the ECDF of its ranks minus the uniform one.

    The shaded band holds the whole curve of uniform ranks with probability 0.95 for
    each quantity. Quantities that are not uniform when all are counted are vermilion.

    Parameters
    ----------
    tree
        From `evaluate.sbc.calibration.calibrate`.
    figure
        An empty Figure to draw in; a new one if None.

    Returns
    -------
    The Figure, with one Axes a quantity.
    """
    ranks, levels, said = ranks_of(tree), levels_of(tree), rank_test(tree)
    rows = -(-len(ranks) // _COLUMNS)
    if figure is None:
        figure = style.new_figure(style.WIDTH, _HEIGHT * rows + 0.4)
    axes = figure.subplots(rows, _COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    at = np.arange(levels + 1) / levels
    allowed = band(said.simulations, levels) - at[:, None]
    for ax, (name, column) in zip(axes, ranks.items(), strict=False):
        bad = said.p[name] * len(ranks) < LEVEL
        ax.fill_between(at, *allowed.T, color=style.PALE, linewidth=0)
        ax.axhline(0.0, color=style.RULE, linewidth=style.HAIR)
        colour = style.VERMILION if bad else style.BLUE
        ax.plot(at, ecdf(column, levels) - at, color=colour, linewidth=style.LINE)
        title = f"{name.replace('_', ' ')}, p = {said.p[name]:.2g}"
        ax.set_title(style.plain(title), fontsize=style.SMALL, color=style.INK)
        style.tidy(ax)
    for ax in axes[len(ranks) :]:
        ax.set_visible(False)
    figure.supxlabel("rank over the number of draws", fontsize=style.LABEL, color=style.INK)
    figure.supylabel("ECDF minus uniform", fontsize=style.LABEL, color=style.INK)
    return figure
