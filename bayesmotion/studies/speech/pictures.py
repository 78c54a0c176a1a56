"""Pictures of the speech study: faces side by side (Figure 4), and how mouths open."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from ...plots.style import HAIR, LABEL, LINE, SERIES, SMALL, WIDTH, new_figure, plain
from .faces import Lips

AROUND = 0.25  # of the face's size is left around it


def faces_figure(
    rows: Mapping[str, Float[np.ndarray, "n h w 3"]], landmarks: Float[np.ndarray, "n l 2"]
) -> Figure:
    """Draw pictures of the same moments under each other, cut out around the landmarks.

    Parameters
    ----------
    rows
        What the rows are called, and their pictures, 0 to 255.
    landmarks
        Of the faces, in pixels.
    """
    count = len(landmarks)
    low, high = landmarks.min(axis=(0, 1)), landmarks.max(axis=(0, 1))
    edge = AROUND * (high - low)
    (left, top), (right, bottom) = np.maximum(low - edge, 0).astype(int), (high + edge).astype(int)
    height = WIDTH / count * (bottom - top) / (right - left)
    figure = new_figure(WIDTH, len(rows) * height + 0.2)
    axes = figure.subplots(len(rows), count, squeeze=False)
    for line, (name, pictures) in zip(axes, rows.items(), strict=True):
        for ax, picture in zip(line, pictures, strict=True):
            ax.imshow(np.clip(picture[top:bottom, left:right] / 255.0, 0.0, 1.0))
            ax.set(xticks=[], yticks=[])
            for spine in ax.spines.values():
                spine.set_visible(False)
        line[0].set_ylabel(plain(name), fontsize=SMALL)
    return figure


def openings_figure(
    shapes: Mapping[str, Float[np.ndarray, "t l 2"]], lips: Lips, frame_rate: float
) -> Figure:
    """Draw the mouth's opening over time, and the height of the lower lip (Figures 5 to 7).

    Parameters
    ----------
    shapes
        Landmarks with the head's place taken off, in pixels; the first is drawn thick.
    lips
        Which landmarks are drawn.
    frame_rate
        Frames a second.
    """
    figure = new_figure(WIDTH, 3.4)
    opening, lower = figure.subplots(2, 1, sharex=True)
    for number, (name, shape) in enumerate(shapes.items()):
        time = (np.arange(len(shape)) + 0.5) / frame_rate
        colour = SERIES[number % len(SERIES)]
        style = {"color": colour, "linewidth": LINE * (1.6 if number == 0 else 0.8)}
        gap = shape[:, lips.lower, 1] - shape[:, lips.upper, 1]
        opening.plot(time, gap, label=plain(name), **style)
        lower.plot(time, shape[:, lips.lower, 1], **style)
    opening.set_ylabel("opening (px)", fontsize=LABEL)
    lower.set_ylabel("lower lip, down (px)", fontsize=LABEL)
    lower.set_xlabel("seconds", fontsize=LABEL)
    for ax in (opening, lower):
        ax.tick_params(labelsize=SMALL, width=HAIR)
    figure.legend(*opening.get_legend_handles_labels(), fontsize=SMALL, frameon=False,
                  loc="outside upper center", ncols=min(len(shapes), 6))  # fmt: skip
    return figure
