"""Fits held against each other."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from . import style


def comparison_plot(rows: Sequence[Mapping[str, Any]], *, figure: Figure | None = None) -> Figure:
    """Draw how far fits fall behind the best one, with one standard error.

    Parameters
    ----------
    rows
        As `evaluate.compare.numbers` gives them, best first: ``fit``, ``elpd_diff``, ``dse`` and
        ``dse_clips``, of which the larger one is drawn.
    figure
        An empty Figure to draw in; a new one if None.
    """
    if figure is None:
        figure = style.new_figure(0.85 * style.WIDTH, 0.8 + 0.25 * len(rows))
    ax = figure.subplots()
    style.tidy(ax, x="difference of the log predictive density from the best")
    ax.axvline(0.0, color=style.RULE, linewidth=style.HAIR)
    for place, row in enumerate(rows):
        errors = [row["dse"], row["dse_clips"]]
        error = max([e for e in errors if np.isfinite(e)], default=0.0)
        colour = style.VERMILION if place else style.BLUE
        ax.errorbar(row["elpd_diff"], place, xerr=error, fmt="o" if place else "s", color=colour,
                    markersize=5, linewidth=1.2)  # fmt: skip
    ax.set_yticks(range(len(rows)), [style.plain(row["fit"]) for row in rows])
    ax.set_ylim(len(rows) - 0.5, -0.5)
    return figure
