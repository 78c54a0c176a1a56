"""Latent spaces: paths of the content, phases, and the vectors of styles."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..errors import InputError
from . import style

_RING = 0.09  # radius by which each clip on a circle is moved out from the one before
_MOST_IN_KEY = 12


def content_path(
    x: Float[np.ndarray, "frame latent"],
    clips: Sequence[str] | np.ndarray,
    *,
    figure: Figure | None = None,
) -> Figure:
    """Draw the path of each clip through latent space, its start marked.

    Two dimensions make one panel, three make three, each seen along an axis. Where
    all points lie on the unit circle, every clip gets a ring of its own, since all
    would hide each other.

    Parameters
    ----------
    x
        (N, 2) or (N, 3): latent points frame by frame.
    clips
        (N,): the clip of each frame.
    figure
        An empty Figure to draw in; a new one if None.

    Returns
    -------
    The Figure, with one Axes a panel.

    Raises
    ------
    InputError
        If there are other than two or three dimensions, lengths disagree or a point is
        not finite.
    """
    owners = _check_points("x", x, clips)
    if x.ndim != 2 or x.shape[1] not in (2, 3):
        raise InputError("x", f"its shape is {x.shape}", "Choose two or three columns")
    names = list(dict.fromkeys(owners.tolist()))
    pairs = [(0, 1)] if x.shape[1] == 2 else [(0, 1), (0, 2), (1, 2)]
    if figure is None:
        size = (3.9, 2.9) if len(pairs) == 1 else (style.WIDTH, 2.4)
        figure = style.new_figure(*size, layout="compressed")
    axes = figure.subplots(1, len(pairs), squeeze=False)[0]
    paths = [x[owners == name] for name in names]
    if x.shape[1] == 2 and np.allclose(np.hypot(x[:, 0], x[:, 1]), 1.0, atol=1e-3):
        paths = [path * (1.0 + _RING * i) for i, path in enumerate(paths)]
        _draw_dial(axes[0], 1.0 + _RING * len(names))
    else:
        _draw_box(axes, pairs, x)
    for path, (colour, marker) in zip(paths, style.marks(len(names)), strict=True):
        for ax, pair in zip(axes, pairs, strict=True):
            _draw_path(ax, path[:, pair], colour, marker)
    _clip_key(figure, names)
    return figure


def phase_plot(
    times: Float[np.ndarray, " frame"],
    phase: Float[np.ndarray, " _frame"],
    clips: Sequence[str] | np.ndarray,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draw the phase of each clip over time, in cycles; the slope is the cadence.

    Parameters
    ----------
    times
        (N,): seconds from each clip's start.
    phase
        (N,): phase in radians, wrapped or not.
    clips
        (N,): the clip of each frame.
    ax
        Where to draw; a new Figure if None.

    Returns
    -------
    The Axes.

    Raises
    ------
    InputError
        If lengths disagree or a value is not finite.
    """
    owners = _check_points("phase", phase, clips)
    _check_points("times", times, clips)
    ax = ax if ax is not None else style.new_figure(0.7 * style.WIDTH, 2.6).subplots()
    style.tidy(ax, x="time (s)", y="phase (cycles)")
    names, lines, labels = list(dict.fromkeys(owners.tolist())), [], []
    for name, (colour, marker) in zip(names, style.marks(len(names)), strict=True):
        seconds, cycles = times[owners == name], np.unwrap(phase[owners == name]) / (2 * np.pi)
        cycles = cycles - np.floor(cycles[0])
        look = {"color": colour, "marker": marker, "markevery": [0], "markersize": 5}
        lines += ax.plot(seconds, cycles, linewidth=style.LINE, **look)
        lasting = seconds[-1] - seconds[0]
        rate = f" ({(cycles[-1] - cycles[0]) / lasting:.2f} cycles/s)" if lasting > 0 else ""
        labels.append(f"{name}{rate}")
    ax.grid(axis="y", color=style.RULE, linewidth=0.4)
    ax.set_axisbelow(True)
    style.key(ax, lines, labels, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return ax


def styles(
    vectors: Float[np.ndarray, "level axis"],
    names: Sequence[str],
    *,
    title: str = "",
    figure: Figure | None = None,
) -> Figure:
    """Draw the vectors of one factor's levels, and how alike they are.

    Style vectors are known up to a rotation only. So they are shown in the plane that
    holds most of their length, and beside it by their inner products, the kernel's own
    measure of likeness, which no rotation changes.

    Parameters
    ----------
    vectors
        (level, axis): one vector a level.
    names
        Names of the levels.
    title
        What the factor is called.
    figure
        An empty Figure to draw in; a new one if None.

    Returns
    -------
    The Figure, with the Axes of the plane and of the inner products.

    Raises
    ------
    InputError
        If there is no vector, lengths disagree or a value is not finite.
    """
    _check_points("vectors", vectors, names)
    if vectors.ndim != 2 or not vectors.shape[1]:
        raise InputError("vectors", f"their shape is {vectors.shape}", "Give (level, axis)")
    if figure is None:
        figure = style.new_figure(style.WIDTH, max(2.6, 1.2 + 0.22 * len(names)))
    plane, table = figure.subplots(1, 2)
    handles = _draw_plane(plane, vectors)
    _draw_products(table, vectors @ vectors.T, names)
    if title:
        figure.suptitle(style.plain(title), fontsize=style.TITLE, color=style.INK)
    style.key(figure, handles, names, loc="outside left center")
    return figure


def _draw_path(ax: Axes, points: np.ndarray, colour: str, marker: str) -> None:
    """Draw one clip's path, thin with its frames as dots, and a mark where it starts."""
    ax.plot(*points.T, color=colour, linewidth=1.0, marker=".", markersize=2.2)
    look = {"color": colour, "markersize": 6.5, "markeredgecolor": "white", "zorder": 4}
    ax.plot(*points[:1].T, marker=marker, linestyle="none", **look)


def _draw_box(axes: np.ndarray, pairs: Sequence[tuple[int, int]], x: np.ndarray) -> None:
    """Give all panels the same limits, true to scale, so that they show one box."""
    low, high = float(x.min()), float(x.max())
    air = 0.08 * max(high - low, 1e-9)
    for ax, (across, up) in zip(axes, pairs, strict=True):
        style.tidy(ax, x=f"latent {across + 1}", y=f"latent {up + 1}")
        limits = (low - air, high + air)
        ax.set(xlim=limits, ylim=limits, aspect="equal")
        ax.locator_params(nbins=5)


def _draw_dial(ax: Axes, radius: float) -> None:
    """Draw a dial of the cycle around rings that all stand for the unit circle."""
    style.tidy(ax)
    reach = 1.2 * radius
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    look = {"color": style.FAINT, "fontsize": style.SMALL, "ha": "center", "va": "center"}
    for quarter, label in enumerate(("0", "¼", "½", "¾")):
        direction = np.array([np.cos(quarter * np.pi / 2), np.sin(quarter * np.pi / 2)])
        ax.plot(*np.outer(direction, [0, radius]), color=style.RULE, linewidth=style.HAIR, zorder=0)
        across, up = 1.1 * radius * direction
        ax.text(across, up, label, **look)
    ax.text(0, 0.3, "cycle", bbox={"color": "white", "pad": 1.5}, **look)
    note = "one unit circle, a ring for each clip"
    ax.set_title(note, fontsize=style.SMALL, color=style.FAINT)


def _clip_key(figure: Figure, names: Sequence[str]) -> None:
    """Tell the clips' colours and marks, and where paths start."""
    handles = [
        Line2D([], [], color=colour, marker=marker, markeredgecolor="white", markersize=6.5, lw=1.2)
        for colour, marker in style.marks(len(names))
    ]
    columns = 1 + (len(names) - 1) // _MOST_IN_KEY
    place = {"loc": "outside right center", "ncols": columns, "title": "clip (mark: start)"}
    style.key(figure, handles, names, title_fontsize=style.SMALL, **place)


def _draw_plane(ax: Axes, vectors: np.ndarray) -> list[Line2D]:
    """Draw vectors as arrows in the plane that holds most of their length."""
    left, size, _ = np.linalg.svd(vectors, full_matrices=False)
    flat = np.zeros((len(vectors), 2))
    flat[:, : min(2, len(size))] = (left * size)[:, :2]
    # The sign of a singular vector is arbitrary: let most point right and up.
    flat *= np.where(flat.sum(axis=0) < 0, -1.0, 1.0)
    share = np.sum(size[:2] ** 2) / max(np.sum(size**2), 1e-300)
    style.tidy(ax, x="principal direction 1", y="principal direction 2")
    note = f"principal plane, {100 * share:.0f}% of squared length"
    ax.set_title(note, fontsize=style.LABEL, color=style.INK, loc="left")
    ax.axhline(0, color=style.RULE, linewidth=style.HAIR, zorder=0)
    ax.axvline(0, color=style.RULE, linewidth=style.HAIR, zorder=0)
    handles = []
    for point, (colour, marker) in zip(flat, style.marks(len(flat)), strict=True):
        ax.plot([0, point[0]], [0, point[1]], color=colour, linewidth=1.0, alpha=0.7)
        look = {"color": colour, "markersize": 7, "markeredgecolor": "white"}
        handles += ax.plot(*point[:, None], marker=marker, linestyle="none", zorder=4, **look)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.12)
    return handles


def _draw_products(ax: Axes, products: np.ndarray, names: Sequence[str]) -> None:
    """Draw inner products as a table of shades, the numbers written in where they fit."""
    most = max(float(np.abs(products).max()), 1e-300)
    ax.imshow(products, cmap="PuOr_r", vmin=-1.2 * most, vmax=1.2 * most)
    shown = [style.plain(name) for name in names]
    look = {"fontsize": style.SMALL, "color": style.INK}
    ax.set_xticks(range(len(names)), shown, rotation=45, ha="right", rotation_mode="anchor", **look)
    ax.set_yticks(range(len(names)), shown, **look)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.set_title("inner products", fontsize=style.LABEL, color=style.INK, loc="left")
    if len(names) <= 8:
        for (i, j), value in np.ndenumerate(products):
            colour = "white" if abs(value) > 0.75 * most else style.INK
            place = {"ha": "center", "va": "center", "fontsize": style.SMALL}
            ax.text(j, i, f"{value:.2f}".replace("-", "−"), color=colour, **place)


def _check_points(what: str, values: np.ndarray, names: Sequence[str] | np.ndarray) -> np.ndarray:
    """Refuse values that are not finite or not one a name; give the names as texts."""
    if not len(values) or len(values) != len(names):
        raise InputError(
            what, f"there are {len(values)} for {len(names)} names", "Give one name for each"
        )
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values))[0][0])
        raise InputError(f"{what}, row {row}", "it is not finite", "Leave such rows out")
    return np.array([str(name) for name in names])
