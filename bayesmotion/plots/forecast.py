"""Forecasts as curves: joint angles with their bands, and errors frame by frame."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..errors import InputError
from . import style

# Shapes are checked here with a message for the user, so their sizes stay open.
Series = Float[np.ndarray, "_frame _angle"]

_PANEL = 1.0  # inches
_MODEL, _TRUTH, _GIVEN = style.BLUE, style.BLACK, "#EFEFEF"


def forecast_plot(
    times: Float[np.ndarray, " frame"],
    truth: Series | None,
    middle: Series,
    band: tuple[Series, Series] | None,
    given: int,
    labels: Sequence[str],
    *,
    level: float = 0.9,
    title: str = "",
    figure: Figure | None = None,
) -> Figure:
    """Draw forecast angles over time, one panel an angle.

    Parameters
    ----------
    times
        (frame,): seconds, rising.
    truth
        (frame, angle): what really happened in degrees, NaN where not known; None if
        nothing is known.
    middle
        (frame, angle): predictive medians (or means) in degrees.
    band
        Lower and upper quantiles (frame, angle) in degrees; None to draw no band.
    given
        Number of frames at the start that were given; they are shaded.
    labels
        Names of the angles.
    level
        Probability of the band.
    title
        What stands above the picture.
    figure
        An empty Figure to draw in; a new one if None.

    Returns
    -------
    The Figure, with one Axes an angle from top to bottom.

    Raises
    ------
    InputError
        If shapes disagree or a setting cannot be used.
    """
    low, high = (None, None) if band is None else band
    _check_shapes(
        times, {"truth": truth, "middle": middle, "band": low, "band above": high}, labels
    )
    _check_times(times, given)
    if not 0 < level < 1:
        raise InputError("level", f"it is {level}", "Give a probability such as 0.9")
    if figure is None:
        figure = style.new_figure(
            0.7 * style.WIDTH, _PANEL * len(labels) + 0.8 + 0.25 * bool(title)
        )
    axes = figure.subplots(len(labels), 1, sharex=True, squeeze=False)[:, 0]
    for i, (ax, label) in enumerate(zip(axes, labels, strict=True)):
        style.tidy(ax)
        ax.set_title(style.plain(label), fontsize=style.LABEL, color=style.INK, loc="left", pad=3)
        _shade_given(ax, times, given)
        _draw_angle(ax, times, truth, middle, band, i)
    axes[-1].set_xlabel("time (s)", fontsize=style.LABEL, color=style.INK)
    figure.supylabel("angle (degrees)", fontsize=style.LABEL, color=style.INK)
    if title:
        figure.suptitle(style.plain(title), fontsize=style.TITLE, color=style.INK)
    _forecast_key(figure, given, level, truth is not None, band is not None)
    figure.align_ylabels(axes)
    return figure


def forecast_errors(
    times: Float[np.ndarray, " frame"],
    errors: Mapping[str, Float[np.ndarray, " _frame"]],
    given: int = 0,
    *,
    unit: str = "rad",
    ax: Axes | None = None,
) -> Axes:
    """Draw the error of each frame for a model and what it is compared with.

    Parameters
    ----------
    times
        (frame,): seconds, rising.
    errors
        By name (frame,): errors, NaN where there is none. The first is the model, drawn
        strongest.
    given
        Number of frames at the start that were given; they are shaded.
    unit
        Unit of the errors.
    ax
        Where to draw; a new Figure if None.

    Returns
    -------
    The Axes.

    Raises
    ------
    InputError
        If there are no errors or shapes disagree.
    """
    if not errors:
        raise InputError("errors", "there are none", "Give at least those of the model")
    for name, values in errors.items():
        if np.shape(values) != np.shape(times):
            raise InputError(
                f"errors of {name!r}",
                f"they have the shape {np.shape(values)} for {len(times)} times",
                "Give one number a frame",
            )
    _check_times(times, given)
    ax = ax if ax is not None else style.new_figure(0.7 * style.WIDTH, 2.4).subplots()
    style.tidy(ax, x="time (s)", y=f"error ({unit})")
    _shade_given(ax, times, given)
    lines = []
    styles = ["-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1))]
    for i, values in enumerate(errors.values()):
        colour, dashes = style.SERIES[i % len(style.SERIES)], styles[i % len(styles)]
        strong = 1.8 if i == 0 else 1.2
        lines += ax.plot(times, values, color=colour, linestyle=dashes, linewidth=strong)
    _set_limits(ax, times)
    ax.set_ylim(bottom=0)
    handles, labels = [*lines], [*errors]
    if given:
        handles, labels = [*lines, Patch(facecolor=_GIVEN)], [*errors, "given frames"]
    style.key(ax, handles, labels, loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=2.4)
    return ax


def _draw_angle(
    ax: Axes,
    times: np.ndarray,
    truth: Series | None,
    middle: Series,
    band: tuple[Series, Series] | None,
    i: int,
) -> None:
    """Draw band, middle and truth of one angle."""
    if band is not None:
        low, high = (edge[:, i] for edge in band)
        ax.fill_between(times, low, high, color=_MODEL, alpha=0.22, linewidth=0, label="band")
    ax.plot(times, middle[:, i], color=_MODEL, linewidth=style.LINE, label="median")
    if truth is not None:
        known, dashes = truth[:, i], (0, (3, 1.5))
        ax.plot(times, known, color=_TRUTH, linewidth=1.1, linestyle=dashes, label="truth")
    _set_limits(ax, times)
    ax.margins(y=0.12)
    ax.locator_params(axis="y", nbins=5, steps=[1, 2, 3, 5, 10])


def _set_limits(ax: Axes, times: np.ndarray) -> None:
    """Let the curves begin and end with the axes."""
    ax.set_xlim(times[0], times[-1])


def _shade_given(ax: Axes, times: np.ndarray, given: int) -> None:
    """Shade the frames that were given, up to half way to the first that was not."""
    if given:
        end = times[-1] if given == len(times) else (times[given - 1] + times[given]) / 2
        ax.axvspan(times[0], end, facecolor=_GIVEN, linewidth=0, zorder=0, label="given")
        ax.axvline(end, color=style.RULE, linewidth=0.8, zorder=0.5)


def _forecast_key(figure: Figure, given: int, level: float, truth: bool, band: bool) -> None:
    """Tell what the curves are, under the panels."""
    rows: list[tuple[bool, Any, str]] = [
        (truth, Line2D([], [], color=_TRUTH, lw=1.1, ls=(0, (3, 1.5))), "truth"),
        (True, Line2D([], [], color=_MODEL, lw=style.LINE), "predictive median"),
        (band, Patch(facecolor=_MODEL, alpha=0.22), f"{100 * level:g}% band"),
        (given > 0, Patch(facecolor=_GIVEN), "given frames"),
    ]
    shown = [(handle, label) for there, handle, label in rows if there]
    handles, labels = zip(*shown, strict=True)
    style.key(figure, handles, labels, loc="outside lower center", ncols=len(shown))


def _check_shapes(
    times: np.ndarray, arrays: Mapping[str, np.ndarray | None], labels: Sequence[str]
) -> None:
    """Refuse arrays that do not fit each other."""
    wanted = (len(times), len(labels))
    if not labels:
        raise InputError("labels", "there are none", "Choose at least one angle")
    for name, values in arrays.items():
        if values is not None and np.shape(values) != wanted:
            raise InputError(
                name,
                f"it has the shape {np.shape(values)} for {wanted[0]} times and {wanted[1]} labels",
                "Give (frame, angle) for the angles that the labels name",
            )


def _check_times(times: np.ndarray, given: int) -> None:
    """Refuse times that do not rise and more given frames than there are."""
    if len(times) < 2 or not (np.diff(times) > 0).all():
        raise InputError("times", "they do not rise", "Give the seconds of at least two frames")
    if not 0 <= given <= len(times):
        raise InputError("given", f"it is {given}", f"Give 0 to {len(times)} frames")
