"""The difference of two conditions, with its bands."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from . import style

if TYPE_CHECKING:
    from ..tasks.contrast import Contrast


def contrast_plot(contrast: "Contrast", figure: Figure | None = None) -> Figure:
    """Draw a contrast: its mean, pointwise interval, simultaneous band, and regions shaded.

    Below it stands the probability at each phase that the first condition's curve is above the
    second's.

    Parameters
    ----------
    contrast
        What `bm.contrast` returned.
    figure
        An empty Figure to draw in; a new one if None.

    Returns
    -------
    The Figure with its two Axes.
    """
    from ..tasks.contrast_design import told

    figure = figure or style.new_figure(0.7 * style.WIDTH, 3.6)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    along, share = contrast.along, f"{100 * contrast.probability:g} %"
    for region in contrast.regions():
        ends = [(region.start, region.end)]
        if region.start > region.end:
            ends = [(region.start, along[-1]), (along[0], region.end)]
        for start, end in ends:
            top.axvspan(start, end, color=style.ORANGE, alpha=0.25, linewidth=0.0)
    low, high = contrast.band()
    top.fill_between(along, low, high, color=style.BLUE, alpha=0.15, linewidth=0.0,
                     label=f"{share} band")  # fmt: skip
    low, high = contrast.interval()
    top.fill_between(along, low, high, color=style.BLUE, alpha=0.3, linewidth=0.0,
                     label=f"{share} at each {contrast.design.axis}")  # fmt: skip
    top.plot(along, contrast.mean, color=style.BLUE, linewidth=style.LINE, label="mean")
    for level in {0.0, contrast.rope, -contrast.rope}:
        top.axhline(level, color=style.INK, linewidth=style.HAIR,
                    linestyle="-" if level == 0.0 else "--")  # fmt: skip
    top.set_title(
        f"{told(contrast.first)} less {told(contrast.second)}", fontsize=style.TITLE, loc="left"
    )
    top.set_ylabel("difference", fontsize=style.LABEL)
    top.legend(fontsize=style.SMALL, frameon=False)
    bottom.plot(along, contrast.positive, color=style.INK, linewidth=style.LINE)
    bottom.set_ylim(-0.05, 1.05)
    bottom.set_yticks(np.array([0.0, 0.5, 1.0]))
    bottom.set_ylabel("P(> 0)", fontsize=style.LABEL)
    bottom.set_xlabel(contrast.design.axis, fontsize=style.LABEL)
    for ax in (top, bottom):
        ax.tick_params(labelsize=style.SMALL)
        ax.margins(x=0.0)
    return figure
