"""From sound to face: the latent path of new sound, and what its points say about the face.

Of a trained shared model, the path X* of new sound Y* is where the joint of sound and
dynamics is largest (Deena and Galata 2009, eq. 9),

    log p(Y*, X*) = sum_t sum_d log N(y*_td | mean_d(x*_t), variance(x*_t) + 1 / beta)
                    + log N(x*_1 | 0, I) + sum_t log N(x*_t | h(x*_{t-1}), variance_h + noise)

each frame given the trained processes, paths of unit scale in the dynamics. The search
begins at what the back-constraint makes of the sound (start A), or at those training points
that are the likeliest path through a hidden Markov model (start B): its states are training
points, its emissions p(y*_t | x), its transitions the dynamics, and the path is Viterbi's.
The face is then the mean at X*, with the process's variance and the noise (eq. 10).

A model whose map is the identity has no path to search for: its points are the sound's.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import AnyArray
from ..inference.optimise import maximise
from ..models.shared_gplvm import SharedGPLVM
from ..models.shared_processes import SharedGiven, in_unit_scale, view_points
from ..models.shared_views import SharedTraining

Start = Literal["A", "B"]
STATES = 1000  # of the hidden Markov model, at most
PADDED = 128  # paths are filled up to a multiple, so that few lengths are compiled
PRIVATE_DRAWS = 16


class Face(NamedTuple):
    """A predicted view (T, D), in its units, with standard deviations, noise included."""

    mean: Float[np.ndarray, "t d"]
    spread: Float[np.ndarray, "t d"]


class Search(NamedTuple):
    """What a search for a path is given.

    sound
        (T, D) scaled features of the view that is heard; what comes after the clip is zero.
    weight
        (T,) 1 for the clip's frames, 0 after it.
    previous
        (Q,) the point before the first frame, of unit scale; with `continues` 1.
    """

    sound: Float[AnyArray, "t d"]
    weight: Float[AnyArray, " t"]
    previous: Float[AnyArray, " q"]
    continues: Float[AnyArray, ""]
    given: SharedGiven
    private: Float[AnyArray, "t p"]


@dataclass(frozen=True)
class PathDensity:
    """The joint log density of sound and path; equal ones share a compilation."""

    heard: str

    def __call__(self, path: Mapping[str, AnyArray], search: Search) -> Array:
        """Evaluate at the path ``x`` (T, Q)."""
        x, given = jnp.asarray(path["x"]), search.given
        private = {self.heard: search.private} if search.private.shape[1] else {}
        points = view_points(self.heard, given.values, x, private)
        explained = given.views[self.heard]
        said = _frames_log_density(search.sound, *explained(points), explained.beta)
        total = jnp.sum(search.weight * said)
        if given.steps is None:
            return total - 0.5 * jnp.sum(search.weight[:, None] * x**2)
        unit = in_unit_scale(x, given.middle, given.scale)
        before = jnp.concatenate([jnp.asarray(search.previous)[None], unit[:-1]])
        moved = _frames_log_density(unit, *given.steps({"x": before}), given.steps.beta)
        first = -0.5 * jnp.sum(unit[0] ** 2) - 0.5 * unit.shape[1] * np.log(2.0 * np.pi)
        moved = moved.at[0].set(jnp.where(search.continues > 0, moved[0], first))
        return total + jnp.sum(search.weight * moved)


def _frames_log_density(y: AnyArray, mean: AnyArray, variance: AnyArray, beta: AnyArray) -> Array:
    """Log density of every frame (T,) under independent normals."""
    own = variance + 1.0 / beta
    squares = jnp.sum((y - mean) ** 2, axis=1)
    return -0.5 * (squares / own + y.shape[1] * jnp.log(2.0 * jnp.pi * own))


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
        return self.model.given(frames, values)

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
        states = viterbi_states(scaled, self)
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
        filled = _filled(begun)
        starts = {"x": filled[None]}
        optimum = maximise(PathDensity(self.heard), starts, data, max_steps=max_steps)
        return np.asarray(optimum.best()["x"])[: len(scaled)]

    def search_data(
        self, scaled: np.ndarray, private: np.ndarray, previous: np.ndarray | None = None
    ) -> Search:
        """Give what `PathDensity` is evaluated with, filled up to few lengths."""
        given = self.given
        weight = _filled(np.ones((len(scaled), 1)))[:, 0]
        before, continues = np.zeros(self.model.latent_size), 0.0
        if previous is not None:
            before = np.asarray(in_unit_scale(previous[None], given.middle, given.scale))[0]
            continues = 1.0
        return Search(_filled(scaled), weight, before, np.array(continues), given, _filled(private))

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
            paths = _draw_paths(self.heard, data, _filled(mode), path_key, draws, warmup)
        shown = [self.show(path[: len(sound)]) for path in paths]
        white = np.asarray(jax.random.normal(noise_key, (draws, *shown[0].mean.shape)))
        return np.stack([f.mean + w * f.spread for f, w in zip(shown, white, strict=True)])

    def online(self) -> "Online":
        """Begin with sound that comes in pieces."""
        return Online(self)


def _filled(a: np.ndarray) -> np.ndarray:
    """Fill rows up with zeros to a multiple of `PADDED`."""
    return np.pad(np.asarray(a), ((0, -len(a) % PADDED), (0, 0)))


def _draw_paths(heard, data: Search, mode: np.ndarray, key, draws: int, warmup: int):
    from numpyro.infer import MCMC, NUTS

    density = PathDensity(heard)

    def potential(x: AnyArray) -> Array:
        # Frames after the clip are N(0, I): they count for nothing.
        after = jnp.sum((1.0 - data.weight)[:, None] * x**2)
        return 0.5 * after - density({"x": x}, data)

    sampler = MCMC(
        NUTS(potential_fn=potential, max_tree_depth=7),
        num_warmup=warmup, num_samples=draws, progress_bar=False,
    )  # fmt: skip
    sampler.run(key, init_params=jnp.asarray(mode))
    return np.asarray(sampler.get_samples())


def viterbi_states(scaled: Float[np.ndarray, "t d"], speaker: Speaker) -> Int[np.ndarray, " t"]:
    """Give the training frames that are the likeliest path through the training points.

    At most `STATES` of them, at even distances, are states. A transition's density is that of
    the point it leads to, without dynamics all are alike.
    """
    given = speaker.given
    x = np.asarray(given.values["x"])
    rows = np.unique(np.linspace(0, len(x) - 1, min(len(x), STATES)).astype(int))
    emission, transition = _hmm(speaker.heard, scaled, given, rows)
    path = likeliest_path(np.asarray(emission), np.asarray(transition))
    return rows[path]


@partial(jax.jit, static_argnames="heard")
def _hmm(heard: str, scaled: AnyArray, given: SharedGiven, rows: AnyArray):
    """Log emissions (T, S) and transitions (S, S) of training points."""
    x = jnp.asarray(given.values["x"])[rows]
    own = given.values.get(f"{heard}_private")
    private = {} if own is None else {heard: jnp.asarray(own)[rows]}
    explained = given.views[heard]
    said = explained(view_points(heard, given.values, x, private))
    emission = jax.vmap(
        lambda y: _frames_log_density(jnp.broadcast_to(y, said[0].shape), *said, explained.beta)
    )(jnp.asarray(scaled))
    if given.steps is None:
        return emission, jnp.zeros((len(rows), len(rows)))
    unit = in_unit_scale(x, given.middle, given.scale)
    mean, variance = given.steps({"x": unit})
    own_variance = variance + 1.0 / given.steps.beta
    squares = jnp.sum(mean**2, axis=1)[:, None] + jnp.sum(unit**2, axis=1) - 2.0 * mean @ unit.T
    each = squares / own_variance[:, None]
    return emission, -0.5 * (each + unit.shape[1] * jnp.log(own_variance)[:, None])


def likeliest_path(
    emission: Float[np.ndarray, "t s"], transition: Float[np.ndarray, "s s"]
) -> Int[np.ndarray, " t"]:
    """Viterbi's path: log emissions, log transitions from row to column, all begin alike."""
    best, back = emission[0], np.zeros(emission.shape, int)
    for t in range(1, len(emission)):
        every = best[:, None] + transition
        back[t] = np.argmax(every, axis=0)
        best = every[back[t], np.arange(every.shape[1])] + emission[t]
    path = np.empty(len(emission), int)
    path[-1] = int(np.argmax(best))
    for t in range(len(emission) - 1, 0, -1):
        path[t - 1] = back[t, path[t]]
    return path


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
