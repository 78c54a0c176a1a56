"""What a page is made of: sentences, tables, pictures, and pages in frames."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from io import BytesIO
from typing import Protocol, runtime_checkable

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ..view.pages import iframe
from ..view.viewer import View

# A picture of more lines is smaller as pixels.
LARGEST_SVG, DPI = 300_000, 160
LONG = 14  # rows
# Numbers smaller than this are what rounding leaves of zero.
NOTHING = 1e-12


@runtime_checkable
class Block(Protocol):
    """A part of a section."""

    def html(self) -> str:
        """Return it as HTML."""
        ...


@dataclass(frozen=True)
class Sentences:
    """Sentences, a paragraph each, or with a mark of their own as a list."""

    texts: Sequence[str]
    listed: bool = False
    warning: bool = False

    def html(self) -> str:
        """Return them as HTML."""
        kind = ' class="warning"' if self.warning else ""
        if self.listed:
            items = "".join(f"<li>{escape(text)}</li>" for text in self.texts)
            return f"<ul{kind}>{items}</ul>"
        return "".join(f"<p{kind}>{escape(text)}</p>" for text in self.texts)


@dataclass(frozen=True)
class Rows:
    """Pairs of what is told and what it is."""

    pairs: Sequence[tuple[str, str]]

    def html(self) -> str:
        """Return them as a table."""
        rows = "".join(
            f"<tr><th scope='row'>{escape(name)}</th><td>{escape(text)}</td></tr>"
            for name, text in self.pairs
        )
        return f"<div class='wide'><table class='pairs'>{rows}</table></div>"


@dataclass(frozen=True)
class Table:
    """A table of numbers, and what it shows; a long one is opened by those who want it.

    figures
        How numbers are written.
    """

    frame: pd.DataFrame
    caption: str
    figures: str = ".3f"

    def html(self) -> str:
        """Return it as HTML; what is not known is a dash."""
        name = self.frame.index.name or ""
        head = "".join(f"<th scope='col'>{escape(str(c))}</th>" for c in (name, *self.frame))
        body = "".join(
            f"<tr><th scope='row'>{escape(str(label))}</th>"
            + "".join(f"<td>{escape(self._cell(value))}</td>" for value in row)
            + "</tr>"
            for label, row in zip(
                self.frame.index, self.frame.itertuples(index=False, name=None), strict=True
            )
        )
        rows = f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
        told = escape(self.caption)
        if len(self.frame) > LONG:
            summary = f"{told} ({len(self.frame)} rows)"
            return f"<details><summary>{summary}</summary><div class='wide'><table>{rows}</details>"
        # Beside the table, not in it: on a phone a table may be wider than the page.
        return f"<p class='caption'>{told}</p><div class='wide'><table>{rows}"

    def _cell(self, value: object) -> str:
        if value is None:
            return "–"
        if isinstance(value, bool | np.bool_ | str):
            return str(value)
        if isinstance(value, int | np.integer):
            return str(value)
        number = float(value)  # pyright: ignore[reportArgumentType]
        if np.isnan(number):
            return "–"
        return format(0.0 if abs(number) < NOTHING else number, self.figures)


@dataclass(frozen=True)
class Picture:
    """A figure, and what is seen on it, in words."""

    figure: Figure
    caption: str

    def html(self) -> str:
        """Return it as a picture that the page holds."""
        out = BytesIO()
        self.figure.savefig(out, format="svg", metadata={"Date": None})
        kind = "svg+xml"
        if out.tell() > LARGEST_SVG:
            out, kind = BytesIO(), "png"
            self.figure.savefig(out, format="png", dpi=DPI)
        data = b64encode(out.getvalue()).decode("ascii")
        text = escape(self.caption, quote=True)
        return (
            f'<figure><img src="data:image/{kind};base64,{data}" alt="{text}">'
            f"<figcaption>{text}</figcaption></figure>"
        )


@dataclass(frozen=True)
class Frame:
    """A player."""

    view: View

    def html(self) -> str:
        """Return it in a frame of its own."""
        return iframe(self.view.html, self.view.scene.title)


@dataclass(frozen=True)
class Section:
    """A part of a page: what it is about, and its blocks."""

    title: str
    blocks: tuple[Block, ...]

    def html(self, name: str) -> str:
        """Return it as HTML, to be linked to by a name."""
        body = "\n".join(block.html() for block in self.blocks)
        return f'<section id="{name}"><h2>{escape(self.title)}</h2>\n{body}\n</section>'
