"""The latent path of new sound: how likely it is, where it may begin, and draws of it.

Of a trained shared model the joint of new sound Y* and its path X* is (Deena and Galata 2009,
eq. 9)

    log p(Y*, X*) = sum_t sum_d log N(y*_td | mean_d(x*_t), variance(x*_t) + 1 / beta)
                    + log N(x*_1 | 0, I) + sum_t log N(x*_t | h(x*_{t-1}), variance_h + noise)

each frame given the trained processes, paths of unit scale in the dynamics. A hidden Markov
model has training points for states, p(y*_t | x) for emissions and the dynamics for
transitions: Viterbi's path through it is where a search may begin.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from ..gp.linalg import AnyArray
from ..models.shared_processes import SharedGiven, in_unit_scale, view_points

STATES = 1000  # of the hidden Markov model, at most
PADDED = 128  # paths are filled up to a multiple, so that few lengths are compiled


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


def filled(a: np.ndarray) -> np.ndarray:
    """Fill rows up with zeros to a multiple of `PADDED`."""
    return np.pad(np.asarray(a), ((0, -len(a) % PADDED), (0, 0)))


def draw_paths(
    heard: str,
    data: Search,
    mode: Float[np.ndarray, "t q"],
    key: PRNGKeyArray,
    draws: int,
    warmup: int,
) -> Float[np.ndarray, "s t q"]:
    """Draw paths by NUTS from the joint of sound and dynamics, from the mode on."""
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


def viterbi_states(
    scaled: Float[np.ndarray, "t d"], heard: str, given: SharedGiven
) -> Int[np.ndarray, " t"]:
    """Give the training frames that are the likeliest path through the training points.

    At most `STATES` of them, at even distances, are states. A transition's density is that of
    the point it leads to, without dynamics all are alike.

    Parameters
    ----------
    scaled
        (T, D) scaled features of the view that is heard.
    heard
        Its name.
    given
        The trained model.
    """
    x = np.asarray(given.values["x"])
    rows = np.unique(np.linspace(0, len(x) - 1, min(len(x), STATES)).astype(int))
    emission, transition = _hmm(heard, scaled, given, rows)
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
