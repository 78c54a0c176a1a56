"""`report`: what a fit says, and how far it is to be trusted, on one page that needs nothing else.

Warnings stand first, in words. What follows is of any model: what was fitted to what, convergence
on identified quantities, parameters, latent points, posterior predictive checks, forecasts beside
what happened, and a comparison of several fits. The player stands before these.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from importlib.resources import files
from typing import ClassVar

import xarray as xr

from .. import __version__
from ..errors import InputError
from ..evaluate.diagnostics import diagnose
from ..fit import Fit
from ..model import AngleData
from ..motion.joining import split
from ..view.pages import Page, filled
from . import sections as parts
from .blocks import Section, Sentences

DRAWS = 100


@dataclass(frozen=True, repr=False)
class Report(Page):
    """A page on one fit or several.

    title
        What stands above it.
    warnings
        What is to be known before anything on it is believed, in sentences.
    sections
        Its parts.
    """

    title: str
    warnings: tuple[str, ...]
    sections: tuple[Section, ...]
    height: ClassVar[int] = 700

    @cached_property
    def html(self) -> str:
        """The whole page."""
        static = files(__package__) / "static"
        links = "".join(
            f'<a href="#part{number}">{escape(one.title)}</a>'
            for number, one in enumerate(self.sections)
        )
        texts = {
            "title": escape(self.title),
            "style": (static / "report.css").read_text(encoding="utf-8"),
            "links": links,
            "sections": "\n".join(
                one.html(f"part{number}") for number, one in enumerate(self.sections)
            ),
            "made": escape(f"bayesmotion {__version__}"),
        }
        return filled(static / "report.html", texts)

    def __repr__(self) -> str:
        """Return what is on the page, warnings first."""
        lines = [f"  warning: {text}" for text in self.warnings]
        lines += [f"  {one.title}" for one in self.sections[1:]]
        return "\n".join([f"Report: {self.title}", *lines])


def report(
    fit: Fit | Mapping[str, Fit],
    *,
    clips: xr.Dataset | None = None,
    context: int | None = None,
    draws: int = DRAWS,
    title: str = "",
    seed: int = 0,
) -> Report:
    """Return a page on a fit of any model, or on several of the same recordings.

    Parameters
    ----------
    fit
        A fit, or several by name.
    clips
        New clips, to be forecast beside what happened; the first training clip where there are
        none, which is no test and said to be none.
    context
        How many frames of them the model sees; half of each clip where None.
    draws
        At most so many draws of a fit are used in checks, forecasts and comparisons.
    title
        What stands above it.
    seed
        Of all that is random.

    Returns
    -------
    The page: `Report.write` writes it, and notebooks show it.

    Raises
    ------
    InputError
        If there is no fit, or clips cannot be forecast by it.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> model, recordings = bm.example("relevance_vectors")
    >>> page = bm.report(bm.fit(model, recordings, seed=0))
    >>> page.write("report.html")  # doctest: +SKIP
    """
    fits = {"": fit} if isinstance(fit, Fit) else dict(fit)
    if not fits:
        raise InputError("report", "there is no fit", "Give one")
    doubts: list[str] = []
    body: list[Section] = []
    shown = None
    for name, one in fits.items():
        head = f"{name}: " if name else ""
        found = diagnose(one)
        doubts += [f"{head}{text}" for text in parts.doubts(one, found)]
        future, said, view = parts.forecasts(
            head, one, _to_forecast(one, clips), context, draws, seed
        )
        doubts += [f"{head}{text}" for text in said]
        shown = shown or view
        body += [
            parts.what_was_fitted(head, one), parts.convergence(head, one, found),
            parts.parameters(head, one), parts.latent(head, one),
            parts.checks(head, one, draws, seed), future,
        ]  # fmt: skip
    if len(fits) > 1:
        compared, said = parts.comparison(fits, draws)
        doubts += said
        body.append(compared)
    body.insert(0, parts.player(fits, shown))
    doubts = list(dict.fromkeys(doubts))
    models = " and ".join(dict.fromkeys(one.model.name for one in fits.values()))
    return Report(title or f"A fit of {models}", tuple(doubts), (_first(doubts), *body))


def _first(doubts: list[str]) -> Section:
    """Return the section that stands first."""
    if not doubts:
        return Section("Before you trust it", (Sentences(["Nothing speaks against it."]),))
    return Section("Before you trust it", (Sentences(doubts, listed=True, warning=True),))


def _to_forecast(fit: Fit, clips: xr.Dataset | None) -> dict[str, xr.Dataset]:
    """Return the clips that are forecast, by name."""
    if not isinstance(fit.training, AngleData):
        if clips is not None:
            raise InputError(
                f"model {fit.model.name!r}", "it forecasts no motions", "Leave the clips out"
            )
        return {}
    if clips is not None:
        return split(clips)
    name, first = next(iter(split(fit.motion).items()))
    return {name: first}
