"""Recorded statistics on the scale of those that a model draws."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from ..errors import InputError
from . import style

_LIMIT = 4.0  # half widths of the interval beyond which a point is drawn at the edge


def checks_plot(
    drawn: Float[np.ndarray, "draw statistic"],
    recorded: Float[np.ndarray, " statistic"],
    names: Sequence[str],
    *,
    probability: float = 0.9,
    figure: Figure | None = None,
) -> Figure:
    """Draw where recorded statistics lie among those of outcomes drawn from a model.

    Every statistic is a row, moved and scaled so that the central interval of the draws goes
    from -1 to 1. Recorded values outside are vermilion squares, and arrows where they lie
    farther away than there is room.

    Parameters
    ----------
    drawn
        Statistics of drawn outcomes, NaN where they could not be measured.
    recorded
        Those of the recordings.
    names
        What they are.
    probability
        Of the interval.
    figure
        An empty Figure to draw in; a new one if None.

    Raises
    ------
    InputError
        If there is nothing to draw.
    """
    if not len(names) or drawn.shape != (len(drawn), len(names)) or len(recorded) != len(names):
        raise InputError("statistics", f"{drawn.shape} draws for {len(names)} names", "Give both")
    if figure is None:
        figure = style.new_figure(0.85 * style.WIDTH, 0.7 + 0.17 * len(names))
    tail = 0.5 * (1.0 - probability)
    low, middle, high = np.nanquantile(drawn, (tail, 0.5, 1.0 - tail), axis=0)
    half = np.maximum(0.5 * (high - low), 1e-12)
    centre = 0.5 * (high + low)
    place = np.clip((recorded - centre) / half, -_LIMIT, _LIMIT)
    rows = np.arange(len(names))
    ax = figure.subplots()
    style.tidy(ax, x=f"recorded, in half widths of the {probability:.0%} interval of the draws")
    ax.axvspan(-1.0, 1.0, color=style.PALE, zorder=0)
    ax.plot((middle - centre) / half, rows, "|", color=style.FAINT, markersize=6)
    for row in rows:
        inside = abs(place[row]) <= 1.0
        far = abs(place[row]) >= _LIMIT
        marker = (">" if place[row] > 0 else "<") if far else ("o" if inside else "s")
        colour = style.BLUE if inside else style.VERMILION
        ax.plot(place[row], row, marker, color=colour, markersize=4.5)
    ax.set_yticks(rows, [style.plain(name) for name in names], fontsize=style.SMALL)
    ax.set(xlim=(-1.08 * _LIMIT, 1.08 * _LIMIT), ylim=(len(names) - 0.4, -0.6))
    return figure
