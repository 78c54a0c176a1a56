"""Keyposes as a picture: the energy flow with beats and keyposes, and the poses themselves."""

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.figure import Figure

from ..models.keyposes.rule import KeyposeFrames
from . import style
from .stick import stick_figures

MOST = 12  # figures drawn


def keyposes_plot(
    motion: xr.Dataset,
    flow: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]],
    beats: Float[np.ndarray, " b"],
    found: KeyposeFrames,
) -> Figure:
    """Draw the energy flow of one clip in both frames of reference, and its keyposes.

    Parameters
    ----------
    motion
        Motion of one clip.
    flow
        Energy in the global and in the body's frame, metres or the clip's unit a second.
    beats
        Seconds from the first frame.
    found
        The keyposes. At most `MOST` are drawn as figures, evenly chosen.
    """
    rate = float(motion.attrs["frame_rate"])
    figure = style.new_figure(style.WIDTH, 3.8)
    above, below = figure.subplots(2, 1, height_ratios=[1.0, 1.0])
    time = np.arange(len(flow[0])) / rate
    for part, name, colour in zip(
        flow, ("global", "body"), (style.BLUE, style.VERMILION), strict=True
    ):
        above.plot(time, part, color=colour, linewidth=style.LINE, label=f"{name} frame")
        own = [f for f, source in zip(found.frame, found.source, strict=True) if source == name]
        above.plot(np.array(own) / rate, part[own], "o", color=colour, markersize=4)
    for beat in beats[(beats >= 0) & (beats <= time[-1])]:
        above.axvline(beat, color=style.RULE, linewidth=style.HAIR, zorder=0)
    style.tidy(above, x="seconds", y="energy flow")
    style.key(above, *above.get_legend_handles_labels(), loc="upper right", ncols=2)
    shown = found.frame
    if len(shown) > MOST:
        shown = shown[np.linspace(0, len(shown) - 1, MOST).round().astype(int)]
    if len(shown):
        stick_figures(motion, frames=shown, ax=below, travel=False)
    else:
        below.set_axis_off()
    return figure
