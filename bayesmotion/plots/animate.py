"""Moving pictures of one motion, or of two over each other or side by side."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr
from matplotlib.animation import AbstractMovieWriter, HTMLWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..errors import InputError
from ..files import replacing
from . import style
from .bodies import Body, View, body_of
from .strips import draw_figure, frame_axes, side_key

SUFFIXES = (".gif", ".html")
GHOST = dict.fromkeys(style.SIDES, "#A6A6A6")

_HEIGHT, _WIDTH = 2.6, 2.4  # inches of the picture of one body
_SHORTEST = 4  # hundredths of a second that a picture lasts, at least
_MARGIN = 0.25  # metres around the body
_POST = 0.5  # metres between marks on the floor


def animate(
    motion: xr.Dataset,
    path: str | Path,
    *,
    other: xr.Dataset | None = None,
    names: tuple[str, str] = ("forecast", "truth"),
    arrange: Literal["overlaid", "beside"] = "overlaid",
    given: int | None = None,
    view: View = "three_quarter",
    max_pictures: int = 150,
    dpi: float = 100.0,
) -> Path:
    """Write a moving picture of a clip at its true speed; the view moves along.

    Parameters
    ----------
    motion
        Motion of one clip, with joint angles, y up.
    path
        Where to; the suffix (.gif or .html) decides the format. An HTML page holds
        its pictures and needs nothing else.
    other
        A second clip of the same frame rate, for example what really happened. Each
        lasts as long as it does; the one that ends first disappears.
    names
        What the two are called.
    arrange
        The second one "overlaid" in grey, both seen in the direction of the first and
        starting in one place, or "beside".
    given
        Number of frames at the start that the motion was forecast from.
    view
        "side", "front" or "three_quarter", from where the body goes.
    max_pictures
        At most so many pictures; there are 25 a second, fewer where clips are longer.
    dpi
        Pixels an inch; the picture is 2.6 inches high and 2.4 wide a body.

    Returns
    -------
    The path.

    Raises
    ------
    InputError
        If the suffix is not known, a clip cannot be drawn, frame rates differ or a
        setting cannot be used.
    OSError
        If the file cannot be written.
    """
    path = Path(path)
    suffix = style.check_suffix(path, SUFFIXES)
    _check(max_pictures, dpi, arrange)
    bodies = [body_of(motion, view)]
    if other is not None:
        _check_rates(motion, other)
        overlaid = arrange == "overlaid"
        bodies.append(body_of(other, view, beside=bodies[0] if overlaid else None))
    rate = float(motion.attrs["frame_rate"])
    frames, lasting = _pictures(max(len(body.time) for body in bodies), rate, max_pictures)
    writer = _writer(suffix, lasting)
    scene = _Scene(bodies, names, arrange, given)
    with replacing(path) as temporary, writer.saving(scene.figure, temporary, dpi):
        for frame in frames:
            scene.show(int(frame))
            writer.grab_frame()
    return path


class _Scene:
    """The picture, of which everything that moves is drawn anew for every frame."""

    def __init__(
        self, bodies: list[Body], names: tuple[str, str], arrange: str, given: int | None
    ) -> None:
        """Set up the axes; `show` draws a frame."""
        beside = arrange == "beside" and len(bodies) == 2
        self.overlaid = len(bodies) == 2 and not beside
        self.bodies = _in_one_place(bodies) if self.overlaid else bodies
        self.given, self.time = given, max((b.time for b in bodies), key=len)
        columns = 2 if beside else 1
        self.figure = style.new_figure(_WIDTH * columns, _HEIGHT)
        self.axes = list(self.figure.subplots(1, columns, squeeze=False)[0])
        self.top = max(float(np.nanmax(body.points[..., 1])) for body in bodies) + _MARGIN
        self.reach = max([0.6 * self.top, *(_reach(body) for body in bodies)])
        if len(bodies) == 2:
            for ax, name in zip(self.axes, names, strict=False):
                ax.set_title(style.plain(name), fontsize=style.TITLE, color=style.INK)
        self._key(names)
        self.clock = self.figure.supxlabel(" ", fontsize=style.LABEL, color=style.INK, ha="center")
        self.drawn: list = []
        self.show(0)
        # Everything fixed is laid out once, so that nothing trembles.
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")

    def show(self, frame: int) -> None:
        """Draw one frame."""
        while self.drawn:
            self.drawn.pop().remove()
        for index, body in enumerate(self.bodies):
            ax = self.axes[0 if self.overlaid else index]
            if index == 0 or not self.overlaid:
                self._follow(ax, body, min(frame, len(body.time) - 1))
            if frame < len(body.time):
                ghost = self.overlaid and index == 1
                look = {"colours": GHOST, "zorder": 1.5} if ghost else {}
                self.drawn += draw_figure(ax, body, frame, width=2.0, **look)
        self.clock.set_text(self._clock_text(frame))

    def _follow(self, ax: Axes, body: Body, frame: int) -> None:
        """Move the view to where the body is, past marks on the floor."""
        middle = _middles(body)[frame]
        left, right = middle - self.reach, middle + self.reach
        frame_axes(ax, (left, right, -0.15, self.top))
        posts = np.arange(np.ceil(left / _POST), np.floor(right / _POST) + 1) * _POST
        look = {"color": style.RULE, "zorder": 1}
        self.drawn += ax.plot([left, right], [0, 0], linewidth=1.2, **look)
        self.drawn.append(ax.vlines(posts, -0.06, 0, linewidth=1.0, **look))

    def _clock_text(self, frame: int) -> str:
        """Tell the time, and which frames were given."""
        text = f"{self.time[frame]:.2f} s"
        if self.given is None:
            return text
        return f"{text} · {'given' if frame < self.given else 'forecast'}"

    def _key(self, names: tuple[str, str]) -> None:
        """Tell the colours above the picture."""
        handles, labels = side_key(self.bodies[:1])
        if self.overlaid:
            handles = [*handles, Line2D([], [], color=GHOST["centre"], lw=2.2)]
            labels = [*labels, names[1]]
        where = {"loc": "outside upper center", "ncols": 3, "columnspacing": 1.0}
        if handles:
            style.key(self.figure, handles, labels, **where)


def _middles(body: Body) -> np.ndarray:
    """Give where the middle of the body is, frame by frame, its trembling smoothed away."""
    across = body.points[..., 0]
    middle = (np.nanmin(across, axis=1) + np.nanmax(across, axis=1)) / 2
    root = np.where(np.isnan(across[:, 0]), middle, across[:, 0])
    line = np.polyfit(np.arange(len(root)), root, 1) if len(root) > 1 else [0.0, root[0]]
    steady = np.polyval(line, np.arange(len(root)))
    return steady if np.abs(steady - root).max() < 0.3 * body.stature else root


def _reach(body: Body) -> float:
    """Give half the width in metres that the body needs around its middle."""
    away = np.abs(body.points[..., 0] - _middles(body)[:, None])
    return float(np.nanmax(away)) + _MARGIN


def _in_one_place(bodies: list[Body]) -> list[Body]:
    """Let two bodies that are overlaid start in the same place."""
    first, second = bodies
    apart = second.points[0, 0, 0] - first.points[0, 0, 0]
    moved = second.points - np.array([np.nan_to_num(apart), 0.0])
    return [first, replace(second, points=moved)]


def _pictures(length: int, rate: float, most: int) -> tuple[np.ndarray, int]:
    """Choose the frames shown, and the hundredths of a second (GIF's unit) each lasts."""
    needed = [100.0 / rate, 100.0 * length / rate / most]
    lasting = max(_SHORTEST, *(int(np.ceil(round(time, 6))) for time in needed))
    count = int(np.ceil(round(100.0 * length / rate / lasting, 6)))
    frames = np.round(np.arange(count) * lasting * rate / 100.0).astype(int)
    return np.minimum(frames, length - 1), lasting


def _writer(suffix: str, lasting: int) -> AbstractMovieWriter:
    """Choose the writer of a format; both cut the time of a picture to whole milliseconds."""
    rate = 1000.0 / (10.0 * lasting + 0.5)
    if suffix == ".gif":
        return PillowWriter(fps=rate)  # pyright: ignore[reportArgumentType]
    return HTMLWriter(fps=rate, embed_frames=True, embed_limit=200)  # pyright: ignore


def _check(max_pictures: int, dpi: float, arrange: str) -> None:
    """Refuse settings that cannot be used."""
    if max_pictures < 1:
        raise InputError("max_pictures", f"it is {max_pictures}", "Allow at least one")
    if not 20 <= dpi <= 400:
        raise InputError("dpi", f"it is {dpi}", "Give 20 to 400 pixels an inch")
    if arrange not in ("overlaid", "beside"):
        raise InputError("arrange", f"it is {arrange!r}", "Use 'overlaid' or 'beside'")


def _check_rates(motion: xr.Dataset, other: xr.Dataset) -> None:
    """Refuse clips of different frame rates."""
    rates = [float(one.attrs["frame_rate"]) for one in (motion, other)]
    if not np.isclose(rates[0], rates[1]):
        raise InputError(
            "other",
            f"it has {rates[1]:g} frames a second, the motion has {rates[0]:g}",
            "Bring both to one frame rate with resample()",
        )
