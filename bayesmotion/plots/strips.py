"""Stick figures side by side on a floor line: where they stand and how they are drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from ..errors import InputError
from . import style
from .bodies import HEAD, Body

_AIR = 0.06  # metres left free between two figures
_BANDS = 10  # heights at which figures are kept apart
_TIME_WIDTH = 0.24  # inches that a time under a figure takes
_FINE = 2.3  # points of line for each inch that a metre takes


@dataclass(frozen=True)
class Strip:
    """Figures of one body and where each of them stands.

    Parameters
    ----------
    body
        The body.
    frames
        (figure,): frames shown.
    shift
        (figure,): metres that each is moved to the right from where it was.
    """

    body: Body
    frames: Int[np.ndarray, " figure"]
    shift: Float[np.ndarray, " figure"]

    @property
    def extent(self) -> tuple[float, float, float]:
        """Leftmost, rightmost and highest coordinate."""
        points = self.body.points[self.frames]
        across = points[..., 0] + self.shift[:, None]
        reach = HEAD * self.body.stature
        return float(np.nanmin(across)), float(np.nanmax(across)), np.nanmax(points[..., 1]) + reach

    @property
    def feet(self) -> Float[np.ndarray, " figure"]:
        """Where the middle of each figure is along the floor."""
        across = self.body.points[self.frames, :, 0]
        middle = (np.nanmin(across, axis=1) + np.nanmax(across, axis=1)) / 2
        return middle + self.shift


def frames_shown(
    clip: str, length: int, count: int, frames: Sequence[int] | np.ndarray | None
) -> Int[np.ndarray, " figure"]:
    """Choose the frames: those given, or `count` evenly spread from first to last.

    Raises
    ------
    InputError
        If there are none, or one is not in the clip.
    """
    if frames is None:
        if count < 1:
            raise InputError("count", f"it is {count}", "Show at least one figure")
        return np.unique(np.linspace(0, length - 1, min(count, length)).round().astype(int))
    chosen = np.asarray(frames, dtype=int)
    if not chosen.size or chosen.min() < 0 or chosen.max() >= length:
        raise InputError(
            f"frames of clip {clip!r}",
            f"they are {list(frames)}",
            f"Choose at least one from 0 to {length - 1}",
        )
    return chosen


def strip_of(body: Body, frames: Int[np.ndarray, " figure"], *, travel: bool) -> Strip:
    """Set figures side by side, so that no two touch.

    With `travel`, they are as far apart as they have gone in between, farther where
    they would touch; else all the same distance apart.
    """
    gaps = _gaps(body, frames)
    home = homes(body, frames)
    steps = np.maximum(gaps, np.diff(home)) if travel else np.full(len(gaps), gaps.max(initial=0))
    places = np.concatenate([[0.0], np.cumsum(steps)])
    return Strip(body, frames, places - home)


def homes(body: Body, frames: Int[np.ndarray, " figure"]) -> Float[np.ndarray, " figure"]:
    """Give where each figure is: its root, or its middle where that is not known."""
    across = body.points[frames, :, 0]
    return np.where(np.isnan(across[:, 0]), np.nanmean(across, axis=1), across[:, 0])


def _gaps(body: Body, frames: Int[np.ndarray, " figure"]) -> Float[np.ndarray, " gap"]:
    """Give the least distances at which neighbours do not touch, height by height."""
    outlines = np.array([_outline(body, int(frame)) for frame in frames])
    free = outlines[:-1, 1] - outlines[1:, 0]
    return np.max(free, axis=1, initial=0.0) + _AIR


def _outline(body: Body, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Give the leftmost and rightmost points from the root in each band of height."""
    along = np.linspace(0, 1, 9)[:, None, None]
    start, end = (body.points[frame, body.bones[:, i]] for i in (0, 1))
    points = (start + along * (end - start)).reshape(-1, 2)
    skull = body.skull[frame] + HEAD * body.stature * np.array([[1, 0], [-1, 0], [0, 1.0]])
    points = np.concatenate([points, skull])
    points = points[np.isfinite(points).all(axis=1)]
    across = points[:, 0] - homes(body, np.array([frame]))
    band = np.clip(points[:, 1] / (1.1 * body.stature) * _BANDS, 0, _BANDS - 1).astype(int)
    left, right = np.full(_BANDS, np.inf), np.full(_BANDS, -np.inf)
    np.minimum.at(left, band, across)
    np.maximum.at(right, band, across)
    # A neighbour's limb one band higher or lower is to stay clear, too.
    near = [slice(None, -1), slice(1, None)]
    wide_left, wide_right = left.copy(), right.copy()
    for here, there in (near, near[::-1]):
        wide_left[here] = np.minimum(wide_left[here], left[there])
        wide_right[here] = np.maximum(wide_right[here], right[there])
    return wide_left, wide_right


def draw_figure(
    ax: Axes,
    body: Body,
    frame: int,
    shift: float = 0.0,
    *,
    colours: Mapping[str, str] = style.SIDES,
    width: float = style.LINE,
    zorder: float = 2.0,
) -> list:
    """Draw one figure, what is nearer over what is farther; give the artists."""
    move = np.array([shift, 0.0])
    order = np.argsort(body.depth[frame][body.bones].mean(axis=1), kind="stable")
    lines = LineCollection(
        list((body.points[frame] + move)[body.bones[order]]),
        colors=[style.GREEN if body.made_up[i] else colours[body.sides[i]] for i in order],
        linewidths=width,
        capstyle="round",
        zorder=zorder,
    )
    artists: list = [ax.add_collection(lines, autolim=False)]
    skull = body.skull[frame] + move
    if np.isfinite(skull).all():
        look = {"facecolor": "white", "edgecolor": colours["centre"], "linewidth": width}
        circle = Circle(tuple(skull), HEAD * body.stature, zorder=zorder + 0.1, **look)
        artists.append(ax.add_patch(circle))
    return artists


def draw_strip(ax: Axes, strip: Strip, inches: float) -> None:
    """Draw all figures of a strip, the smaller a metre is in `inches`, the finer."""
    width = float(np.clip(_FINE * inches, 0.5 * style.LINE, style.LINE))
    for frame, shift in zip(strip.frames, strip.shift, strict=True):
        draw_figure(ax, strip.body, int(frame), float(shift), width=width)


def draw_floor(ax: Axes, left: float, right: float) -> None:
    """Draw the line the figures stand on."""
    ax.plot([left, right], [0, 0], color=style.RULE, linewidth=1.0, zorder=1, label="floor")


def scale_of(ax: Axes, metres: float) -> float:
    """Give about how many inches a metre takes in an Axes that is to show so many."""
    return ax.get_position().width * style.root_figure(ax).get_figwidth() / metres


def write_times(ax: Axes, strip: Strip, inches: float) -> None:
    """Write under the figures when it was; where `inches` a metre leave no room, under some."""
    feet, times = strip.feet, strip.body.time[strip.frames]
    nearest = np.abs(np.diff(feet)).min(initial=np.inf) * inches
    every = 1 if nearest >= _TIME_WIDTH else int(np.ceil(_TIME_WIDTH / nearest))
    for index in range(0, len(feet), every):
        ax.annotate(
            f"{times[index]:.2f}" + (" s" if index == 0 else ""),
            (feet[index], 0),
            xytext=(0, -5),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=style.SMALL,
            color=style.FAINT,
            annotation_clip=False,
        )


def frame_axes(ax: Axes, box: tuple[float, float, float, float]) -> None:
    """Show the box (left, right, bottom, top) in metres, true to scale and without ticks."""
    ax.set(xlim=box[:2], ylim=box[2:], aspect="equal", xticks=[], yticks=[])
    ax.spines[:].set_visible(False)


def side_key(bodies: Sequence[Body]) -> tuple[list[Line2D], list[str]]:
    """Give handles and labels that tell the colours of sides and of what is made up."""
    sides = {side for body in bodies for side in body.sides}
    there = [side for side in ("left", "right") if side in sides]
    handles = [Line2D([], [], color=style.SIDES[side], lw=2.2) for side in there]
    if any(any(body.made_up) for body in bodies):
        return [*handles, Line2D([], [], color=style.GREEN, lw=2.2)], [*there, "filled in"]
    return handles, there
