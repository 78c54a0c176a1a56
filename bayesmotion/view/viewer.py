"""`view`: one page that shows motions moving, and needs nothing else.

The page holds its script, its style and its numbers (`packing`), and asks for nothing: it opens
from disk and works without a network.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from importlib.resources import files
from pathlib import Path

import xarray as xr

from ..errors import InputError
from ..files import FIT, VOXELS
from ..fit import Fit, load
from ..inference.predicting import Prediction
from ..motion.io.reading import read
from ..sensing.voxels.carving import load_voxels
from . import tracks
from .pages import Page, filled
from .scene import Arrangement, Cloud, Scene, Track
from .sound import sound_of

# Ghosts of one prediction; and megabytes that a page has at most, for which some are left out.
DRAWS, LARGEST = 50, 25.0
TRUTH = "truth"
SCRIPTS = ("unpack.js", "renderer.js", "figures.js", "player.js", "controls.js")
Viewable = xr.Dataset | tracks.Outcome | Prediction | Fit | str | Path


@dataclass(frozen=True, repr=False)
class View(Page):
    """A page on which motions are seen moving; notebooks show it as it is.

    scene
        What is on it.
    """

    scene: Scene

    @cached_property
    def html(self) -> str:
        """The whole page."""
        static = files(__package__) / "static"
        script = "\n".join((static / name).read_text(encoding="utf-8") for name in SCRIPTS)
        # No text in it may end the script that holds it.
        content = json.dumps(self.scene.content(), separators=(",", ":")).replace("<", "\\u003c")
        texts = {
            "title": escape(self.title),
            "style": (static / "player.css").read_text(encoding="utf-8"),
            "script": script,
            "content": content,
        }
        return filled(static / "player.html", texts)

    def __repr__(self) -> str:
        """Return what is on the page."""
        named = ", ".join(thing.name for thing in (*self.scene.tracks, *self.scene.clouds))
        return f"View of {named}: .write('player.html') makes a page, notebooks show it"

    @property
    def title(self) -> str:
        """What stands above it."""
        return self.scene.title


def view(
    *what: Viewable,
    truth: xr.Dataset | None = None,
    names: Sequence[str] = (),
    draws: int = DRAWS,
    arrangement: str | None = None,
    sound: str | Path | None = None,
    sound_start: float = 0.0,
    title: str = "",
    seed: int = 0,
) -> View:
    """Return a page that shows motions moving, in three dimensions.

    Parameters
    ----------
    what
        Motions (each of their clips is a body), what a task returned (`forecast`, `reconstruct`,
        `synthesize`, `denoise`, `fill_gaps`: its mean, and draws of it as ghosts), a `Prediction`,
        a fit (its training clips), voxels, or files of motions, voxels and fits.
    truth
        What really happened, shown with the first of them.
    names
        What the bodies are called, in their order; by default as their clips.
    draws
        At most so many ghosts of each prediction; fewer where the page would be larger than 25 MB.
    arrangement
        ``overlaid``, all in one place, or ``beside`` each other; by default predictions are
        overlaid with the truth, and different clips are beside each other. The page can change it.
    sound
        A sound file that is heard in step with the motion: .mp3, .wav, .ogg, .m4a, .flac or .mp4.
    sound_start
        The second of the sound at which the motion begins.
    title
        What stands above it.
    seed
        Of the choice among draws.

    Returns
    -------
    The page: `View.write` writes it, and notebooks show it.

    Raises
    ------
    InputError
        If there is nothing to be seen, a file cannot be used, or there are more or fewer names
        than bodies.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> page = bm.view(bm.synthetic_walkers(("ann",), ("walk", "run"), seconds=1.0))
    >>> page.write("walks.html")  # doctest: +SKIP
    """
    _check(what, draws)
    bodies: list[Track] = []
    clouds: list[Cloud] = []
    messages: list[str] = []
    for one in what:
        made, points = _shown(one, draws, seed)
        bodies += made
        clouds += points
        messages += getattr(one, "messages", ())
    if truth is not None:
        bodies = [*tracks.tracks_of_motion(truth, "truth", names=(TRUTH,)), *bodies]
    if names:
        bodies = _named(bodies, names, truth is not None)
    if not clouds:
        # Voxels have a place in the world: there nothing is moved.
        bodies = tracks.in_one_place(bodies)
    several = sum(body.role != "truth" for body in bodies) + len(clouds) > 1
    together = bool(bodies and clouds) or not several
    scene = Scene(
        title or ", ".join(thing.name for thing in (*bodies, *clouds) if thing.name != TRUTH),
        tuple(bodies),
        tuple(clouds),
        _arrangement(arrangement, "overlaid" if together else "beside"),
        None if sound is None else sound_of(sound, sound_start),
        tuple(dict.fromkeys(messages)),
    )
    return _small_enough(View(scene))


def _shown(one: Viewable, draws: int, seed: int) -> tuple[list[Track], list[Cloud]]:
    """Return the bodies and the clouds of one thing that is to be seen."""
    if isinstance(one, str | Path):
        return _of_file(Path(one), draws, seed)
    if isinstance(one, Fit):
        if "voxel" in one.motion:
            return [], tracks.clouds_of(one.motion)
        return tracks.tracks_of_fit(one), []
    if isinstance(one, Prediction):
        return tracks.tracks_of_prediction(one, draws, seed), []
    if isinstance(one, xr.Dataset):
        if "voxel" in one:
            return [], tracks.clouds_of(one)
        return tracks.tracks_of_motion(one), []
    if isinstance(one, tracks.Outcome):
        return tracks.tracks_of_outcome(one, draws, seed), []
    raise InputError(
        f"view of a {type(one).__name__}", "it is nothing that moves",
        "Give motions, what a task returned, a prediction, a fit, voxels, or files",
    )  # fmt: skip


def _of_file(path: Path, draws: int, seed: int) -> tuple[list[Track], list[Cloud]]:
    if FIT.holds(path):
        return _shown(load(path), draws, seed)
    if VOXELS.holds(path):
        return [], tracks.clouds_of(load_voxels(path))
    return tracks.tracks_of_motion(read(path)), []


def _named(bodies: list[Track], names: Sequence[str], truth: bool) -> list[Track]:
    first, others = bodies[:truth], bodies[truth:]
    if len(names) != len(others):
        raise InputError(
            "names", f"there are {len(names)} for {len(others)} bodies", "Give one for each body"
        )
    return [*first, *(replace(body, name=str(n)) for body, n in zip(others, names, strict=True))]


def _small_enough(page: View) -> View:
    """Return a page that is not too large: with fewer ghosts, and a sentence that says so."""
    drawn = max((len(t.ghosts.where) for t in page.scene.tracks if t.ghosts), default=0)
    count = drawn
    while (size := len(page.html.encode()) / 1e6) > LARGEST and count > 1:
        count = min(count - 1, int(0.9 * count * LARGEST / size))
        bodies = tuple(_with_fewer(track, max(count, 1)) for track in page.scene.tracks)
        told = (
            f"{max(count, 1)} of {drawn} draws are on this page, which otherwise would have more "
            f"than {LARGEST:g} MB"
        )
        messages = (*(m for m in page.scene.messages if "draws are on this page" not in m), told)
        page = View(replace(page.scene, tracks=bodies, messages=messages))
    return page


def _with_fewer(track: Track, count: int) -> Track:
    ghosts = track.ghosts
    return replace(track, ghosts=ghosts and replace(ghosts, where=ghosts.where[:count]))


def _check(what: Sequence[object], draws: int) -> None:
    if not what:
        raise InputError("view", "there is nothing to be seen", "Give a motion")
    if draws < 0:
        raise InputError("draws", f"it is {draws}", "Give 0 or more")


def _arrangement(name: str | None, usual: Arrangement) -> Arrangement:
    if name is None:
        return usual
    if name != "overlaid" and name != "beside":
        raise InputError(f"arrangement {name!r}", "there is no such", "Use overlaid or beside")
    return name
