"""Pages inside others: what notebooks and reports show."""

from html import escape

HEIGHT = 560  # pixels


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
