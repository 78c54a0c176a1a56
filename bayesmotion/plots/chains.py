"""Chains of draws: how each moved, and whether all rank alike."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import binom, rankdata

from ..errors import InputError
from . import style

_BINS = 20
_BAND = 0.99  # of the counts in a bin, if all chains rank alike


def chains_plot(
    draws: Mapping[str, Float[np.ndarray, "chain draw"]], *, figure: Figure | None = None
) -> Figure:
    """Draw every quantity's traces, and beside them how its chains rank.

    On the right is, for each chain, how many of its draws have a rank (among all
    chains' draws) in each twentieth; chains that agree stay in the grey band, which
    holds 99 % of the counts if draws are independent.

    Parameters
    ----------
    draws
        Name to draws (chain, draw), at least one, four draws or more.
    figure
        An empty Figure to draw in; a new one if None.

    Raises
    ------
    InputError
        If there is nothing to draw, or a draw is not finite.
    """
    if not draws:
        raise InputError("draws", "there are none", "Give at least one quantity")
    for name, value in draws.items():
        if value.shape[1] < 4 or not np.all(np.isfinite(value)):
            raise InputError(
                name, "it has fewer than four draws, or some that are not finite", "Leave it out"
            )
    if figure is None:
        figure = style.new_figure(style.WIDTH, 0.5 + 1.25 * len(draws))
    grid = figure.subplots(len(draws), 2, squeeze=False, width_ratios=(2.2, 1.0))
    for (left, right), (name, value) in zip(grid, draws.items(), strict=True):
        _trace(left, name, value)
        _ranks(right, value)
    for ax in grid[:-1].ravel():
        ax.set_xlabel("")
        ax.set_xticklabels([])
    return figure


def _trace(ax: Axes, name: str, value: np.ndarray) -> None:
    for chain, colour in zip(value, _colours(len(value)), strict=True):
        ax.plot(chain, color=colour, linewidth=style.HAIR, alpha=0.8)
    style.tidy(ax, x="draw")
    ax.set_title(style.plain(name), fontsize=style.LABEL, color=style.INK, loc="left")
    ax.margins(x=0.01)


def _ranks(ax: Axes, value: np.ndarray) -> None:
    count = value.shape[1]
    bins = min(_BINS, max(count // 5, 2))
    rank = rankdata(value).reshape(value.shape) / value.size
    edges = np.linspace(0.0, 1.0, bins + 1)
    tail = (1.0 - _BAND) / 2.0
    low, high = (float(q) for q in binom.ppf([tail, 1.0 - tail], count, 1.0 / bins))
    ax.axhspan(low, high, color=style.PALE, zorder=0)
    for chain, colour in zip(rank, _colours(len(value)), strict=True):
        counts, _ = np.histogram(chain, edges)
        ax.stairs(counts, edges, color=colour, linewidth=0.8 * style.LINE)
    style.tidy(ax, x="rank among all draws", y="draws")
    ax.set_ylim(bottom=0.0)
    ax.set_xlim(0.0, 1.0)


def _colours(count: int) -> list[str]:
    return [colour for colour, _ in style.marks(count)]
