"""From sound to face: the latent path of new sound, and what its points say about the face.

Of a trained shared model, the path X* of new sound Y* is where the joint of sound and
dynamics is largest (`speech_paths`). The search begins at what the back-constraint makes of the
sound (start A), or at the likeliest path through training points (start B). The face is then
the mean at X*, with the process's variance and the noise (Deena and Galata 2009, eq. 10).

A model whose map is the identity has no path to search for: its points are the sound's.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import AnyArray
from ..inference.optimise import maximise
from ..models.shared_gplvm import SharedGPLVM
from ..models.shared_processes import SharedGiven, in_unit_scale, view_points
from ..models.shared_views import SharedTraining
from .speech_paths import PathDensity, Search, draw_paths, filled, viterbi_states

Start = Literal["A", "B"]
PRIVATE_DRAWS = 16


class Face(NamedTuple):
    """A predicted view (T, D), in its units, with standard deviations, noise included."""

    mean: Float[np.ndarray, "t d"]
    spread: Float[np.ndarray, "t d"]


@dataclass(frozen=True)
class Speaker:
    """A trained shared model that makes one view of another.

    Parameters
    ----------
    fit
        Of a `SharedGPLVM` with a back-constraint.
    heard, shown
        The view that is given, which must be that of the back-constraint, and the other.

    Raises
    ------
    InputError
        If the model has no such views.
    """

    fit: Fit
    heard: str = "audio"
    shown: str = "face"

    def __post_init__(self) -> None:
        """Check the views once."""
        model = self.fit.model
        if not isinstance(model, SharedGPLVM) or model.back != self.heard:
            raise InputError(
                self.heard, "the model has no back-constraint on it", "Fit one that has"
            )
        if self.shown not in model.views:
            raise InputError(
                self.shown, "the model has no such view", f"Use {', '.join(model.views)}"
            )

    @property
    def model(self) -> SharedGPLVM:
        """The model."""
        return self.fit.model

    @cached_property
    def training(self) -> SharedTraining:
        """All frames of the training clips."""
        return self.model.prepare(self.fit.motion)

    @cached_property
    def given(self) -> SharedGiven:
        """The model conditioned on all frames of the training clips."""
        values = {name: jnp.asarray(value) for name, value in self.fit.values().items()}
        frames = self.training.frames
        x, private = self._mapped(frames.seen, values)
        values["x"] = x
        if private.shape[1]:
            values[f"{self.heard}_private"] = private
        return self.model.condition(frames, values)

    def _mapped(self, seen: AnyArray, values: Mapping[str, AnyArray]) -> tuple[Array, Array]:
        both = self.model.mapped(seen, self.training.frames.centres, values)
        q = self.model.latent_size
        return jnp.asarray(both)[:, :q], jnp.asarray(both)[:, q:]

    def path(self, sound: Float[np.ndarray, "t d"], start: str = "A", *, search: bool = True,
             max_steps: int = 100) -> Float[np.ndarray, "t q"]:  # fmt: skip
        """Find the latent path of sound features (T, D), in their units.

        Parameters
        ----------
        start
            ``A``, the back-constraint, or ``B``, Viterbi's path over training points.
        search
            Whether to go on from there to where the joint is largest.

        Raises
        ------
        InputError
            If the features are not those of training, or there is no such start.
        """
        scaled = self.training.encoding.scaled(self.heard, sound)
        begun, private = self._begin(scaled, start)
        if not search or self.model.constraint.kind == "identity":
            return begun
        return self._climb(scaled, begun, private, None, max_steps)

    def _begin(self, scaled: np.ndarray, start: str) -> tuple[np.ndarray, np.ndarray]:
        if start not in get_args(Start):
            raise InputError(repr(start), "there is no such start", "Use A or B")
        back = self.training.encoding.back
        assert back is not None
        x, private = self._mapped(back[1](scaled), self.given.values)
        if start == "A":
            return np.asarray(x), np.asarray(private)
        states = viterbi_states(scaled, self.heard, self.given)
        own = self.given.values.get(f"{self.heard}_private")
        return (
            np.asarray(self.given.values["x"])[states],
            np.asarray(private) if own is None else np.asarray(own)[states],
        )

    def _climb(
        self,
        scaled: np.ndarray,
        begun: np.ndarray,
        private: np.ndarray,
        previous: np.ndarray | None,
        max_steps: int,
    ) -> np.ndarray:
        data = self.search_data(scaled, private, previous)
        starts = {"x": filled(begun)[None]}
        optimum = maximise(PathDensity(self.heard), starts, data, max_steps=max_steps)
        return np.asarray(optimum.best()["x"])[: len(scaled)]

    def search_data(
        self, scaled: np.ndarray, private: np.ndarray, previous: np.ndarray | None = None
    ) -> Search:
        """Give what `PathDensity` is evaluated with, filled up to few lengths."""
        given = self.given
        weight = filled(np.ones((len(scaled), 1)))[:, 0]
        before, continues = np.zeros(self.model.latent_size), 0.0
        if previous is not None:
            before = np.asarray(in_unit_scale(previous[None], given.middle, given.scale))[0]
            continues = 1.0
        return Search(filled(scaled), weight, before, np.array(continues), given, filled(private))

    def show(self, path: Float[AnyArray, "t q"], seed: int = 0) -> Face:
        """Give the other view along a latent path.

        Private coordinates of that view, which sound does not tell, are averaged over draws
        from their prior.
        """
        given, size = self.given, self.model.private_sizes()[self.shown]
        explained, draws = given.views[self.shown], PRIVATE_DRAWS if size else 1
        random = np.random.default_rng(seed)
        means, variances = [], []
        for _ in range(draws):
            private = {self.shown: random.normal(size=(len(path), size))} if size else {}
            points = view_points(self.shown, given.values, jnp.asarray(path), private)
            mean, variance = explained(points)
            means.append(np.asarray(mean))
            variances.append(np.asarray(variance))
        mean = np.mean(means, axis=0)
        variance = np.mean(variances, axis=0)[:, None] + np.var(means, axis=0)
        encoding = self.training.encoding
        spread = np.sqrt(variance + 1.0 / float(explained.beta)) * encoding.spread[self.shown]
        return Face(encoding.restored(self.shown, mean), spread)

    def speak(self, sound: Float[np.ndarray, "t d"], start: str = "A") -> Face:
        """Make the other view of sound features (T, D), both in their units."""
        return self.show(self.path(sound, start))

    def draw(
        self, sound: Float[np.ndarray, "t d"], key: PRNGKeyArray, draws: int, warmup: int = 100
    ) -> Float[np.ndarray, "s t f"]:
        """Draw views: paths by NUTS from the joint of sound and dynamics, then the face's noise.

        NUTS begins at the mode. Draws of different frames share a path, not the noise.
        """
        path_key, noise_key = jax.random.split(key)
        scaled = self.training.encoding.scaled(self.heard, sound)
        begun, private = self._begin(scaled, "A")
        paths = np.repeat(begun[None], draws, axis=0)
        if self.model.constraint.kind != "identity":
            mode = self._climb(scaled, begun, private, None, 100)
            data = self.search_data(scaled, private)
            paths = draw_paths(self.heard, data, filled(mode), path_key, draws, warmup)
        shown = [self.show(path[: len(sound)]) for path in paths]
        white = np.asarray(jax.random.normal(noise_key, (draws, *shown[0].mean.shape)))
        return np.stack([f.mean + w * f.spread for f, w in zip(shown, white, strict=True)])

    def online(self) -> "Online":
        """Begin with sound that comes in pieces."""
        return Online(self)


class Online:
    """Sound that comes in pieces, and the face as soon as it can be told.

    A frame is told when the frames that its window sees are there; `finish` tells the last
    ones. Of each piece the path is searched for with what was told before held fast, so that
    it is the whole clip's where no path is searched for, and near it elsewhere.
    """

    def __init__(self, speaker: Speaker) -> None:
        self.speaker = speaker
        self._heard: np.ndarray | None = None
        self._told = 0
        self._last: np.ndarray | None = None

    def feed(self, sound: Float[np.ndarray, "t d"]) -> Face:
        """Take the next frames of sound features; give the frames that can be told."""
        before = [] if self._heard is None else [self._heard]
        self._heard = np.concatenate([*before, np.asarray(sound)])
        return self._tell(len(self._heard) - self.speaker.model.look.width)

    def finish(self) -> Face:
        """Give what is left."""
        if self._heard is None:
            raise InputError("online", "no sound came", "Feed some first")
        return self._tell(len(self._heard))

    def _tell(self, end: int) -> Face:
        speaker, told = self.speaker, self._told
        heard = self._heard
        assert heard is not None
        if end <= told:
            nothing = np.zeros((0, len(speaker.training.encoding.mean[speaker.shown])))
            return Face(nothing, nothing)
        scaled = speaker.training.encoding.scaled(speaker.heard, heard)
        begun, private = speaker._begin(scaled, "A")
        path = begun[told:end]
        if speaker.model.constraint.kind != "identity":
            path = speaker._climb(scaled[told:end], path, private[told:end], self._last, 50)
        self._told, self._last = end, path[-1]
        return speaker.show(path)


def pieces(sound: Float[np.ndarray, "t d"], size: int) -> Iterator[Float[np.ndarray, "s d"]]:
    """Cut sound features into pieces of so many frames."""
    yield from (sound[i : i + size] for i in range(0, len(sound), size))
