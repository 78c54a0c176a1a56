"""How all pictures look: one palette, one set of sizes, one way to save.

Colours are those of Okabe and Ito (2008), told apart with every kind of colour
vision. Nothing here touches matplotlib's global settings: figures are made without
pyplot, so there is nothing to close either.
"""

from collections.abc import Sequence
from io import BytesIO
from itertools import cycle, islice, product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from ..errors import InputError
from ..files import PICTURE, replacing

BLUE, VERMILION, GREEN, ORANGE = "#0072B2", "#D55E00", "#009E73", "#E69F00"
SKY, PURPLE, BLACK = "#56B4E9", "#CC79A7", "#000000"
INK, FAINT, RULE, PALE = "#333333", "#767676", "#B0B0B0", "#EEF4F9"

SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
SIDES = {"left": BLUE, "right": VERMILION, "centre": INK}

WIDTH = 7.0  # inches: the text width of a two-column page
TITLE, LABEL, SMALL = 9.0, 8.0, 7.0  # points
LINE, HAIR = 1.4, 0.6  # points
DPI, SCREEN_DPI = 200, 100


class Shown(Figure):
    """A figure that notebooks show, though pyplot does not know of it."""

    def _repr_png_(self) -> bytes:
        """Return the picture, as IPython asks for it."""
        out = BytesIO()
        self.savefig(out, format="png", dpi=SCREEN_DPI)
        return out.getvalue()


def new_figure(
    width: float,
    height: float,
    layout: Literal["constrained", "compressed"] = "constrained",
) -> Figure:
    """Make a Figure of a size in inches that pyplot does not know of."""
    return Shown(figsize=(width, height), layout=layout, facecolor="white")


def root_figure(ax: Axes) -> Figure:
    """Give the Figure an Axes lies in, also where a SubFigure lies between."""
    figure: Figure | SubFigure | None = ax.get_figure(root=True)
    assert isinstance(figure, Figure)
    return figure


def plain(text: object) -> str:
    """Give a name so that matplotlib writes it as it is, dollar signs and all."""
    return str(text).replace("$", r"\$")


def marks(count: int) -> list[tuple[str, str]]:
    """Give `count` pairs of colour and marker, the first 49 all different.

    The colour changes from one to the next and, after all colours, the marker.
    """
    return [(colour, marker) for marker, colour in islice(cycle(product(MARKERS, SERIES)), count)]


def tidy(ax: Axes, *, x: str = "", y: str = "") -> None:
    """Label an Axes of numbers and leave only the two spines that are read."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set(color=FAINT, linewidth=HAIR)
    ax.tick_params(labelsize=SMALL, colors=INK, color=FAINT, width=HAIR, length=2.5)
    ax.set_xlabel(plain(x), fontsize=LABEL, color=INK)
    ax.set_ylabel(plain(y), fontsize=LABEL, color=INK)


def key(
    owner: Axes | Figure | SubFigure, handles: Sequence[Any], labels: Sequence[object], **where: Any
) -> None:
    """Add a legend without a frame; `where` is passed on to matplotlib."""
    settings = {"fontsize": SMALL, "frameon": False, "labelcolor": INK, "handlelength": 1.6}
    owner.legend(list(handles), [plain(label) for label in labels], **(settings | where))


def save(figure: Figure | Axes, path: str | Path, *, dpi: float = DPI) -> Path:
    """Write a picture; the file is the old one or the new one, never half of one.

    Parameters
    ----------
    figure
        A Figure, or an Axes of the one meant.
    path
        Where to; the suffix (.png, .pdf or .svg) decides the format.
    dpi
        Pixels an inch of a PNG.

    Returns
    -------
    The path.

    Raises
    ------
    InputError
        If the suffix is not known or `dpi` is not positive.
    OSError
        If the file cannot be written.
    """
    path = Path(path)
    PICTURE.check(path)
    suffix = path.suffix.lower()
    if not (np.isfinite(dpi) and dpi > 0):
        raise InputError("dpi", f"it is {dpi}", "Give the pixels an inch, for example 200")
    figure = root_figure(figure) if isinstance(figure, Axes) else figure
    dated = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}
    # The names of parts of an SVG are hashes: salted alike, the same picture is the same file.
    with replacing(path) as temporary, rc_context({"svg.hashsalt": "bayesmotion"}):
        figure.savefig(temporary, dpi=dpi, format=suffix[1:], metadata=dated.get(suffix))
    return path


def check_suffix(path: Path, known: Sequence[str]) -> str:
    """Give the suffix of a path in small letters, if it is among those known.

    Raises
    ------
    InputError
        If it is not.
    """
    suffix = path.suffix.lower()
    if suffix not in known:
        raise InputError(
            path,
            f"pictures ending in {path.suffix or 'nothing'!r} are not known",
            f"Use one of {', '.join(known)}",
        )
    return suffix
