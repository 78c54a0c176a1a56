"""Pictures of motion as stick figures: one clip, several compared, a grid of clips."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..errors import InputError
from ..motion import clips
from . import style
from .bodies import Body, View, body_of
from .strips import (
    Strip,
    draw_floor,
    draw_strip,
    frame_axes,
    frames_shown,
    homes,
    scale_of,
    side_key,
    strip_of,
    write_times,
)

Cell = tuple[str, str]

_MARGIN = 0.2  # metres around figures
_TALLEST = 0.75  # inches a metre, at most
_TEXT = 0.2  # inches for a line of text
_GAP = 0.08  # inches between boxes
_NO_CELLS: frozenset[Cell] = frozenset()


def stick_figures(
    motion: xr.Dataset,
    *,
    count: int = 8,
    frames: Sequence[int] | np.ndarray | None = None,
    view: View = "side",
    travel: bool = True,
    times: bool = True,
    legend: bool = True,
    made_up: Collection[str] = (),
    ax: Axes | None = None,
) -> Axes:
    """Draw a clip as stick figures on a floor line, time running to the right.

    Parameters
    ----------
    motion
        Motion of one clip, with joint angles, y up.
    count
        Number of figures, evenly spread over the clip.
    frames
        The frames to show instead, in the order wanted.
    view
        "side", "front" or "three_quarter", from where the body goes.
    travel
        Whether figures are as far apart as the body went in between (farther, where
        they would touch), or all equally far.
    times
        Whether the time is written under each figure.
    legend
        Whether the colours of left and right are told.
    made_up
        Joints that a model filled in: what hangs on them is drawn green.
    ax
        Where to draw; a new Figure if None.

    Returns
    -------
    The Axes.

    Raises
    ------
    InputError
        If the clip cannot be drawn, or a setting cannot be used.
    """
    strip = _strip(motion, count, frames, view, travel, made_up)
    box = _box([strip])
    if ax is None:
        ax = _figure(box, text=_TEXT * (int(times) + int(legend))).subplots()
    _draw_row(ax, strip, box, times=times)
    if legend:
        _key_below(ax, strip.body, lines=1.7 if times else 0.3)
    return ax


def compare(
    motions: Mapping[str, xr.Dataset],
    *,
    count: int = 8,
    frames: Sequence[int] | np.ndarray | None = None,
    view: View = "side",
    travel: bool = False,
    made_up: Mapping[str, Collection[str]] | None = None,
    figure: Figure | None = None,
) -> Figure:
    """Draw several clips in rows of the same scale, for example truth and forecasts.

    Parameters
    ----------
    motions
        Motions of one clip each, by the labels of their rows.
    count, frames, view, travel
        As in `stick_figures`. Without `travel` figures of all rows that show the same
        frames stand one over the other.
    made_up
        By the label of a row joints that a model filled in: what hangs on them is drawn green.
    figure
        An empty Figure to draw in; a new one if None.

    Returns
    -------
    The Figure, with one Axes a row.

    Raises
    ------
    InputError
        If there is no motion, or one cannot be drawn.
    """
    if not motions:
        raise InputError("motions", "there are none", "Give at least one")
    filled = made_up or {}
    strips = [
        _strip(motion, count, frames, view, travel, filled.get(label, ()))
        for label, motion in motions.items()
    ]
    if not travel:
        strips = _in_step(strips)
    box = _box(strips)
    shared = all(_same_times(strip, strips[0]) for strip in strips) and not travel
    if figure is None:
        text = _TEXT * (2 if shared else 1 + len(strips))
        figure = _figure(box, text, rows=len(strips), labels=_label_width(motions))
    axes = figure.subplots(len(strips), 1, squeeze=False)[:, 0]
    for ax, label, strip in zip(axes, motions, strips, strict=True):
        _draw_row(ax, strip, box, times=ax is axes[-1] or not shared)
        _row_label(ax, label)
    _figure_key(figure, strips)
    return figure


def grid(
    cells: Mapping[Cell, xr.Dataset],
    missing: Collection[Cell] = _NO_CELLS,
    *,
    rows_label: str = "subject",
    columns_label: str = "gait",
    count: int = 6,
    seconds: float | None = 1.0,
    view: View = "side",
    travel: bool = False,
    figure: Figure | None = None,
) -> Figure:
    """Draw clips in rows and columns; those that a model inferred are framed and shaded.

    This is Figure 2 of Wang, Fleet and Hertzmann (2007), with people and gaits.

    Parameters
    ----------
    cells
        Motions of one clip each, by row and column, in the order to be shown.
    missing
        Cells that were not recorded but inferred.
    rows_label, columns_label
        What rows and columns are.
    count
        Number of figures in each cell.
    seconds
        The figures are evenly spread over so many seconds from each clip's start. One
        is about a cycle of walking: over a longer time, a few figures may meet the same
        phase again and again. None for the whole clip.
    view, travel
        As in `stick_figures`.
    figure
        An empty Figure to draw in; a new one if None.

    Returns
    -------
    The Figure, with one Axes a cell, row by row.

    Raises
    ------
    InputError
        If there are no cells, a missing cell has no motion or a motion cannot be drawn.
    """
    _check_cells(cells, missing)
    rows = list(dict.fromkeys(row for row, _ in cells))
    columns = list(dict.fromkeys(column for _, column in cells))
    strips = {
        cell: _strip(_start_of(motion, seconds), count, None, view, travel)
        for cell, motion in cells.items()
    }
    box = _box(list(strips.values()))
    if figure is None:
        labels = _label_width(rows) + _TEXT * bool(rows_label)
        figure = _figure(box, 3 * _TEXT, len(rows), len(columns), labels)
    axes = figure.subplots(len(rows), len(columns), squeeze=False)
    for (i, j), ax in np.ndenumerate(axes):
        cell = (rows[i], columns[j])
        _draw_cell(ax, strips.get(cell), box, inferred=cell in missing)
        if i == 0:
            heading = style.plain(columns[j])
            ax.set_title(heading, fontsize=style.TITLE, color=style.INK, pad=5)
        if j == 0:
            _row_label(ax, rows[i])
    look = {"fontsize": style.LABEL, "color": style.FAINT}
    if columns_label:
        figure.suptitle(style.plain(columns_label), **look)
    if rows_label:
        figure.supylabel(style.plain(rows_label), **look)
    _figure_key(figure, list(strips.values()), inferred=bool(missing))
    return figure


def _strip(
    motion: xr.Dataset,
    count: int,
    frames: Sequence[int] | np.ndarray | None,
    view: View,
    travel: bool,
    made_up: Collection[str] = (),
) -> Strip:
    """Place the figures of one clip."""
    body = body_of(motion, view, made_up=made_up)
    shown = frames_shown(clips(motion)[0], len(body.time), count, frames)
    return strip_of(body, shown, travel=travel)


def _start_of(motion: xr.Dataset, seconds: float | None) -> xr.Dataset:
    """Give the first seconds of a clip."""
    if seconds is None:
        return motion
    if not seconds > 0:
        raise InputError("seconds", f"it is {seconds}", "Give a positive number, or None")
    return motion.isel(frame=slice(round(seconds * float(motion.attrs["frame_rate"])) + 1))


def _in_step(strips: list[Strip]) -> list[Strip]:
    """Set the figures of all strips the same distance apart, the widest of all."""

    own = [homes(strip.body, strip.frames) for strip in strips]
    steps = [np.diff(home + strip.shift) for home, strip in zip(own, strips, strict=True)]
    step = max(float(one.max(initial=0.0)) for one in steps)
    return [
        replace(strip, shift=step * np.arange(len(home)) - home)
        for home, strip in zip(own, strips, strict=True)
    ]


def _same_times(one: Strip, other: Strip) -> bool:
    """Tell whether two strips show the same moments."""
    here, there = one.body.time[one.frames], other.body.time[other.frames]
    return here.shape == there.shape and bool(np.allclose(here, there))


def _box(strips: Sequence[Strip]) -> tuple[float, float, float]:
    """Give width, bottom and top in metres of a picture that has room for each strip."""
    extents = [strip.extent for strip in strips]
    width = max(right - left for left, right, _ in extents) + 2 * _MARGIN
    return width, -0.08, max(top for *_, top in extents) + 0.05


def _figure(
    box: tuple[float, float, float],
    text: float,
    rows: int = 1,
    columns: int = 1,
    labels: float = 0.0,
) -> Figure:
    """Make a Figure in which `rows` times `columns` boxes fill the width of a page.

    `text` is inches of text above and under the boxes, `labels` inches at the left.
    """
    width, height = box[0], box[2] - box[1]
    inches = min(((style.WIDTH - labels) / columns - _GAP) / width, _TALLEST)
    across = labels + columns * (inches * width + _GAP) + _GAP
    down = text + rows * (inches * height + _GAP) + _GAP
    return style.new_figure(max(across, 2.0), down, layout="compressed")


def _label_width(labels: Iterable[str]) -> float:
    """Give about how many inches the labels of rows take."""
    return 0.2 + 0.075 * max(map(len, map(str, labels)))


def _draw_row(ax: Axes, strip: Strip, box: tuple[float, float, float], *, times: bool) -> None:
    """Draw one strip on its floor, in the middle of its box."""
    left, right, _ = strip.extent
    start = (left + right - box[0]) / 2
    frame_axes(ax, (start, start + box[0], box[1], box[2]))
    draw_floor(ax, start, start + box[0])
    inches = scale_of(ax, box[0])
    draw_strip(ax, strip, inches)
    if times:
        write_times(ax, strip, inches)


def _draw_cell(
    ax: Axes, strip: Strip | None, box: tuple[float, float, float], *, inferred: bool
) -> None:
    """Draw one cell of a grid, or say that there is nothing to draw."""
    if strip is None:
        frame_axes(ax, (0.0, *box))
        ax.text(
            0.5, 0.5, "not recorded", transform=ax.transAxes, ha="center", va="center",
            fontsize=style.SMALL, color=style.FAINT,
        )  # fmt: skip
        return
    _draw_row(ax, strip, box, times=False)
    if inferred:
        ax.set_facecolor(style.PALE)
        ax.spines[:].set(visible=True, color=style.GREEN, linewidth=1.6)


def _row_label(ax: Axes, label: str) -> None:
    """Write what a row is at its left."""
    ax.set_ylabel(
        style.plain(label), rotation=0, ha="right", va="center",
        fontsize=style.TITLE, color=style.INK, labelpad=6,
    )  # fmt: skip


def _key_below(ax: Axes, body: Body, lines: float) -> None:
    """Tell the colours under the floor line, so many lines down."""
    handles, labels = side_key([body])
    if handles:
        place = {"loc": "upper left", "bbox_to_anchor": (0.0, 0.0), "borderaxespad": lines}
        style.key(ax, handles, labels, ncols=3, **place)


def _figure_key(figure: Figure, strips: Sequence[Strip], *, inferred: bool = False) -> None:
    """Tell colours and frames under the whole picture."""
    handles, labels = side_key([strip.body for strip in strips])
    if inferred:
        patch = Patch(facecolor=style.PALE, edgecolor=style.GREEN, linewidth=1.6)
        handles, labels = [*handles, patch], [*labels, "inferred by the model"]
    if handles:
        style.key(figure, handles, labels, loc="outside lower center", ncols=len(handles))


def _check_cells(cells: Mapping[Cell, xr.Dataset], missing: Collection[Cell]) -> None:
    """Refuse an empty grid and inferred cells without a motion."""
    if not cells:
        raise InputError("cells", "there are none", "Give at least one motion")
    for cell in missing:
        if cell not in cells:
            raise InputError(
                f"missing cell {cell}",
                "there is no motion of it",
                f"Give the motion that was inferred, or use some of {list(cells)}",
            )
