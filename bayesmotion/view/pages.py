"""Pages that need nothing else: filled in, written, and shown in notebooks and reports."""

import re
from collections.abc import Mapping
from html import escape
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import ClassVar

from ..files import PAGE, write_bytes

HEIGHT = 560  # pixels


class Page:
    """One whole HTML page."""

    title: str
    html: str
    height: ClassVar[int] = HEIGHT

    def write(self, path: str | Path) -> Path:
        """Write the page; an older one stays until the new one is whole.

        Raises
        ------
        InputError
            If the name does not end in ``.html``, or there is a page that is not of this package.
        """
        PAGE.check(path)
        write_bytes(path, self.html.encode())
        return Path(path)

    def _repr_html_(self) -> str:
        """Return the page in a frame, as Jupyter and marimo show it."""
        return iframe(self.html, self.title, self.height)


def filled(template: Traversable, texts: Mapping[str, str]) -> str:
    """Return a page with texts in the places that it names: ``{{title}}``."""
    page = template.read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda found: texts[found[1]], page)


def iframe(page: str, title: str, height: int = HEIGHT) -> str:
    """Return a page in a frame of its own, whose style and names touch nothing around it.

    Parameters
    ----------
    page
        A whole HTML page that needs nothing else.
    title
        What it is, for those who do not see it.
    height
        Of the frame in pixels; it is as wide as there is room.
    """
    style = f"width:100%;height:{height}px;border:1px solid #b0b0b0;border-radius:6px"
    return (
        f'<iframe title="{escape(title, quote=True)}" style="{style}" sandbox="allow-scripts" '
        f'srcdoc="{escape(page, quote=True)}"></iframe>'
    )
