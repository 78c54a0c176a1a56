"""Topology-aware local learning: the mode of many latent points, a patch at a time.

Ding and Fan (2015), section V: a step takes a reference point and its M nearest points
on the ideal surface, and follows the gradient of the patch's own density (eq. 13, 14):

    log p(Y_L | X_L, variance, gamma, beta) + log p(hyperparameters)
        + log p(X_L | their neighbours, W)

References are drawn until every point has been in a patch (a sweep), sweep after
sweep. Points have the step sizes of Adam (Kingma and Ba 2015), each with moments of
its own that only its own patches touch; hyperparameters are shared. The step's cost is
that of M points, whatever N: nothing that has N entries is looked at as a whole.

A patch of all points has the density of the model. What smaller patches agree on is not
quite the mode of the whole density: a patch does not see how points beyond it depend on
its own.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Array, Float, Int
from numpyro.infer.util import log_density as program_log_density
from scipy.spatial import KDTree

from ...errors import InputError
from ...gp.linalg import AnyArray, require_finite
from ...gp.matrix_normal import complete, log_density
from ...model import PointEstimate, Progress
from ...search_state import SearchState
from .data import Cycles
from .hyperparameters import covariance, log_prior
from .settings import Around

PATCH = 120
SHARE = 0.1  # at most so much of all points
FEWEST = 16  # of fewer a kernel learns nothing
RATE = 0.03  # Adam's step size at first
FIRST, SECOND, TINY = 0.9, 0.99, 1e-8  # Adam's
BLOCK = 64  # patches in one compiled call
HYPER = ("beta", "gamma", "variance")


class Learning(NamedTuple):
    """Where local learning stands.

    x
        (N, Q) latent points.
    moments
        (2, N, Q) Adam's.
    count
        (N,) steps that each point has taken.
    hyper, hyper_moments
        (H,) logarithms of the hyperparameters, and (2, H).
    step
        Steps taken.
    """

    x: Float[AnyArray, "n q"]
    moments: Float[AnyArray, "2 n q"]
    count: Float[AnyArray, " n"]
    hyper: Float[AnyArray, " h"]
    hyper_moments: Float[AnyArray, "2 h"]
    step: Float[AnyArray, ""]

    def values(self) -> dict[str, np.ndarray]:
        """Return the values of the program's sites."""
        hyper = np.exp(np.asarray(self.hyper))
        values = {name: np.array(hyper[i]) for i, name in enumerate(HYPER)}
        return {**values, "x": np.asarray(self.x)}


def patch_size(n: int, patch: int = PATCH) -> int:
    """Return the points of a patch: `patch`, but at most a tenth of all, and at least `FEWEST`."""
    return max(min(patch, int(SHARE * n)), min(FEWEST, n))


def sweep(
    tree: KDTree, t: Float[np.ndarray, "n 3"], size: int, random: np.random.Generator
) -> Int[np.ndarray, "patches m"]:
    """Draw patches until every point is in one.

    Parameters
    ----------
    tree
        Of the ideal surface `t`.
    size
        M.
    """
    covered = np.zeros(len(t), bool)
    patches = []
    for reference in random.permutation(len(t)):
        if not covered[reference]:
            patch = tree.query(t[reference], size)[1]
            covered[patch] = True
            patches.append(patch)
    return np.array(patches)


def learn_locally(
    program: Callable[[Cycles], None],
    around: Around,
    cycles: Cycles,
    start: dict[str, np.ndarray],
    *,
    seed: int,
    sweeps: int,
    patch: int = PATCH,
    rate: float = RATE,
    progress: Progress | None = None,
    state: SearchState | None = None,
) -> PointEstimate:
    """Find site values by steps on patches, and the log density of all points there.

    Parameters
    ----------
    program
        Of the model.
    around, cycles, start, seed, sweeps, patch, rate, progress, state
        As in `learn_on_patches`.

    Raises
    ------
    InputError
        If entries are missing.
    NumericalError
        If the log density found is not finite.
    """
    learning = learn_on_patches(
        around, cycles, start,
        seed=seed, sweeps=sweeps, patch=patch, rate=rate, progress=progress, state=state,
    )  # fmt: skip
    values = learning.values()
    sites = {name: jnp.asarray(value) for name, value in values.items()}
    at = numpyro.handlers.substitute(program, data=sites)
    found = float(program_log_density(at, (cycles,), {}, {})[0])
    require_finite(found, "y")
    return PointEstimate(values, found, int(learning.step), converged=True)


def learn_on_patches(
    around: Around,
    cycles: Cycles,
    start: dict[str, np.ndarray],
    *,
    seed: int,
    sweeps: int,
    patch: int = PATCH,
    rate: float = RATE,
    progress: Progress | None = None,
    state: SearchState | None = None,
) -> Learning:
    """Take steps on patches until the surface has been covered `sweeps` times.

    Parameters
    ----------
    around
        The prior of points around the surface.
    cycles
        Training data, nothing missing.
    start
        Values of the sites to begin from.
    seed
        Of the patches.
    sweeps
        How often the whole surface is covered.
    patch
        Points of a patch, at most a tenth of all.
    rate
        Adam's step size at first; it falls to zero along a half cosine, so that learning
        ends by itself.
    progress
        Called with the sweeps done and the log density of the last patch.
    state
        Where earlier learning stood, and where this is kept.

    Raises
    ------
    InputError
        If entries are missing.
    """
    if not np.asarray(cycles.missing.rows).all():
        raise InputError(
            "training cycles", "entries are missing", "Use method 'map', or complete cycles"
        )
    assert cycles.surface is not None
    surface = cycles.surface.points()
    size, random = patch_size(len(surface), patch), np.random.default_rng(seed)
    tree = KDTree(surface)
    learning, state = begin(start), state or SearchState()
    if state.saved is not None:
        learning = Learning(*(jnp.asarray(state.saved[name]) for name in Learning._fields))
    data = (jnp.asarray(cycles.y), jax.tree.map(jnp.asarray, cycles.topology))
    plans = [sweep(tree, surface, size, random) for _ in range(sweeps)]
    patches = np.concatenate(plans)
    rates = 0.5 * rate * (1.0 + np.cos(np.pi * np.arange(len(patches)) / len(patches)))
    begun, limit = state.steps(len(patches))[0], len(patches)
    for first in range(begun, limit, BLOCK):
        block, speed = patches[first : first + BLOCK], rates[first : first + BLOCK]
        short = BLOCK - len(block)
        # The last block is filled up with steps of length zero.
        block = np.concatenate([block, np.repeat(block[-1:], short, axis=0)])
        learning, reached = take_steps(around, learning, data, block, np.pad(speed, (0, short)))
        state.keep(min(first + BLOCK, limit), limit, learning._asdict)
        if progress is not None:
            done = int(sweeps * min(first + BLOCK, len(patches)) / len(patches))
            progress(done, float(reached))
    return learning


def begin(start: dict[str, np.ndarray]) -> Learning:
    """Return the learning that begins at these site values."""
    x = jnp.asarray(start["x"], float)
    hyper = jnp.log(jnp.array([float(start[name]) for name in HYPER]))
    return Learning(
        x, jnp.zeros((2, *x.shape)), jnp.zeros(len(x)), hyper, jnp.zeros((2, len(HYPER))),
        jnp.zeros(()),
    )  # fmt: skip


@partial(jax.jit, static_argnames="around", donate_argnames="learning")
def take_steps(
    around: Around,
    learning: Learning,
    data: tuple,
    patches: Int[AnyArray, "steps m"],
    rates: Float[AnyArray, " steps"],
) -> tuple[Learning, Float[Array, ""]]:
    """Take one step on each patch; return the log density of the last one with it."""
    gradient = jax.value_and_grad(partial(patch_log_density, around), argnums=(0, 1))
    y, topology = data

    def one(learning: Learning, given):
        patch, rate = given
        x = learning.x[patch]
        beyond = learning.x[topology.neighbours[patch]]
        local = (y[patch], topology.neighbours[patch], topology.weights[:, patch], beyond, patch)
        reached, (on_x, on_hyper) = gradient(x, learning.hyper, local, topology.constrained)
        count = learning.count[patch] + 1.0
        moments, moved = _adam(learning.moments[:, patch], on_x, count[:, None])
        step = learning.step + 1.0
        hyper_moments, hyper_moved = _adam(learning.hyper_moments, on_hyper, step)
        return Learning(
            jnp.asarray(learning.x).at[patch].add(rate * moved),
            jnp.asarray(learning.moments).at[:, patch].set(moments),
            jnp.asarray(learning.count).at[patch].set(count),
            learning.hyper + rate * hyper_moved,
            hyper_moments,
            step,
        ), reached

    steps = (jnp.asarray(patches), jnp.asarray(rates))
    learning, reached = jax.lax.scan(one, learning, steps)
    return learning, reached[-1]


def _adam(moments, gradient, count):
    """Return the new moments and the step of length about one that climbs."""
    first = FIRST * moments[0] + (1.0 - FIRST) * gradient
    second = SECOND * moments[1] + (1.0 - SECOND) * gradient**2
    mean, square = first / (1.0 - FIRST**count), second / (1.0 - SECOND**count)
    return jnp.stack([first, second]), mean / (jnp.sqrt(square) + TINY)


def patch_log_density(
    around: Around,
    x: Float[AnyArray, "m q"],
    hyper: Float[AnyArray, " h"],
    local: tuple,
    constrained: Float[AnyArray, " q"],
) -> Float[Array, ""]:
    """Compute the log density of a patch (eq. 14) up to a constant.

    Parameters
    ----------
    x
        Points of the patch.
    hyper
        Logarithms of `HYPER`.
    local
        For the patch's points: features (M, D), neighbours (M, K), weights (Q, M, K),
        where those neighbours are (M, K, Q), and the points' own indices (M,).
    constrained
        As in `Topology`.
    """
    y, neighbours, weights, beyond, patch = local
    values: dict[str, AnyArray] = dict(zip(HYPER, jnp.exp(hyper), strict=True))
    K = covariance(values, x)
    likelihood = log_density(y, K, jnp.ones(y.shape[1]), complete(*y.shape))
    # Neighbours in the patch move with it, those beyond stay where they are.
    same = neighbours[:, :, None] == patch
    inside = jnp.any(same, axis=-1)[..., None]
    near = jnp.where(inside, x[jnp.argmax(same, axis=-1)], jax.lax.stop_gradient(beyond))
    residual = (x - jnp.einsum("qmk,mkq->mq", weights, near)) * constrained
    surface = -jnp.sum(residual**2) / around.sigma**2 - 0.5 * jnp.sum(x**2) / around.latent_sd**2
    return likelihood + surface + log_prior(values)
