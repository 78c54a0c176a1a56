"""Pictures of voxels, and of estimated beside true poses."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure

from ..intervals import NINETY
from .style import BLUE, FAINT, INK, LABEL, SMALL, VERMILION, key, new_figure, plain, tidy


def voxel_figure(
    panels: Sequence[Int[np.ndarray, "_ 3"]], titles: Sequence[str], *, columns: int = 5
) -> Figure:
    """Draw sets of voxels as little cubes, seen from the side and a little above.

    Parameters
    ----------
    panels
        Voxels (n, 3), y up, one set a panel.
    titles
        One for each.
    columns
        Panels in a row.
    """
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    figure = new_figure(1.4 * columns, 2.3 * rows)
    for index, (voxels, title) in enumerate(zip(panels, titles, strict=True)):
        ax = figure.add_subplot(rows, columns, index + 1)
        right, up, depth = _view(voxels)
        order = np.argsort(-depth)  # far ones first, near ones over them
        shade = 0.25 + 0.6 * (depth - depth.min()) / max(float(np.ptp(depth)), 1e-9)
        ax.scatter(
            right[order], up[order], s=5.0, marker="s", c=shade[order], cmap="Blues_r",
            vmin=0.0, vmax=1.2, linewidths=0,
        )  # fmt: skip
        ax.set_aspect("equal")
        ax.set_axis_off()
        ax.set_title(plain(title), fontsize=SMALL, color=INK)
    return figure


def _view(voxels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Turn voxels by 30 degrees and tilt them by 15."""
    turn, tilt = np.radians(30.0), np.radians(15.0)
    x, y, z = (voxels - voxels.mean(axis=0)).T
    right = np.cos(turn) * x - np.sin(turn) * z
    away = -(np.sin(turn) * x + np.cos(turn) * z)
    return right, np.cos(tilt) * y + np.sin(tilt) * away, np.cos(tilt) * away - np.sin(tilt) * y


def descriptor_figure(
    descriptor: Float[np.ndarray, "radial elevation azimuth"], title: str
) -> Figure:
    """Draw one shape context: a panel a shell, elevation down, azimuth across."""
    figure = new_figure(1.7 * len(descriptor), 1.5)
    top = float(descriptor.max()) or 1.0
    for shell, part in enumerate(descriptor):
        ax = figure.add_subplot(1, len(descriptor), shell + 1)
        ax.imshow(part, cmap="Blues", vmin=0.0, vmax=top, aspect="auto")
        ax.set_xticks([])
        ax.set_yticks([])
        ax.set_title(f"shell {shell + 1}", fontsize=SMALL, color=INK)
    figure.suptitle(plain(title), fontsize=LABEL, color=INK)
    return figure


def angle_figure(
    true: Float[np.ndarray, "frame angle"],
    found: Float[np.ndarray, "frame angle"],
    sd: Float[np.ndarray, "frame angle"],
    labels: Sequence[str],
    *,
    columns: int = 2,
) -> Figure:
    """Draw true and estimated angles over the frames, with 90 % intervals, in degrees."""
    rows = -(-len(labels) // columns)
    figure = new_figure(3.5 * columns, 1.3 * rows)
    frames = np.arange(len(true))
    for index, label in enumerate(labels):
        ax = figure.add_subplot(rows, columns, index + 1)
        truth = np.degrees(np.unwrap(true[:, index]))
        # Estimates are drawn in the turn nearest to the truth.
        off = np.degrees((found[:, index] - true[:, index] + np.pi) % (2 * np.pi) - np.pi)
        half = NINETY * np.degrees(sd[:, index])
        low, high = truth + off - half, truth + off + half
        ax.fill_between(frames, low, high, color=VERMILION, alpha=0.2, linewidth=0)
        (estimate,) = ax.plot(frames, truth + off, color=VERMILION, linewidth=0.9)
        (line,) = ax.plot(frames, truth, color=BLUE, linewidth=1.1)
        tidy(ax, y="degrees")
        ax.set_title(plain(label), fontsize=SMALL, color=FAINT)
        if index == 0:
            key(ax, [line, estimate], ["true", "estimated"])
    return figure
