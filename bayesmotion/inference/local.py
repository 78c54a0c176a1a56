"""Topology-aware local learning: the mode of many latent points, a patch at a time.

Ding and Fan (2015), section V: a step takes a reference point and its M nearest points
on the ideal surface, and follows the gradient of the patch's own density (eq. 13, 14):

    log p(Y_L | X_L, variance, gamma, beta) + log p(hyperparameters)
        + log p(X_L | their neighbours, W)

References are drawn until every point has been in a patch (a sweep), sweep after
sweep. Points have the step sizes of Adam (Kingma and Ba 2015), each with moments of
its own that only its own patches touch; hyperparameters are shared. The step's cost is
that of M points, whatever N: nothing that has N entries is looked at as a whole.

What patches agree on is not quite the mode of the whole density: a patch does not see
how points beyond it depend on its own. `learn_locally` gives site values that
`fit_map`'s density can be evaluated at, or that its search can go on from.
"""

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float, Int
from scipy.spatial import KDTree

from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import AnyArray, require_finite
from ..gp.matrix_normal import complete, log_density
from ..models.gait_cycles import Cycles
from ..models.gait_pose import GaitPose, log_hyperprior
from .density import ProgramDensity
from .results import Record, make_fit

PATCH = 120
SHARE = 0.1  # at most so much of all points
FIRST, SECOND, TINY = 0.9, 0.99, 1e-8  # Adam's
BLOCK = 64  # patches in one compiled call
HYPER = ("beta", "gamma", "variance")

Progress = Callable[[int, float | None], None]


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


def patch_size(n: int, patch: int = PATCH) -> int:
    """Points of a patch: `patch`, but at most a tenth of all."""
    return max(min(patch, int(SHARE * n)), 2)


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
    model: GaitPose,
    cycles: Cycles,
    surface: Float[np.ndarray, "n 3"],
    start: dict[str, np.ndarray],
    *,
    seed: int,
    sweeps: int = 40,
    patch: int = PATCH,
    rate: float = 0.03,
    progress: Progress | None = None,
) -> dict[str, np.ndarray]:
    """Find site values by steps on patches.

    Parameters
    ----------
    model
        A model with points free around a surface, without dynamics.
    cycles
        Training data, nothing missing.
    surface
        (N, 3) the ideal surface, where patches are cut.
    start
        Values of the sites to begin from.
    seed
        Of the patches.
    sweeps
        How often the whole surface is covered.
    patch
        Points of a patch, at most a tenth of all.
    rate
        Adam's step size at first; it falls to zero along a half cosine.
    progress
        Called with the sweeps done.

    Raises
    ------
    InputError
        If the model has dynamics or no surface, or entries are missing.
    """
    _check(model, cycles)
    size, random = patch_size(len(surface), patch), np.random.default_rng(seed)
    tree = KDTree(surface)
    learning = begin(start)
    data = (jnp.asarray(cycles.y), jax.tree.map(jnp.asarray, cycles.topology))
    plans = [sweep(tree, surface, size, random) for _ in range(sweeps)]
    patches = np.concatenate(plans)
    rates = 0.5 * rate * (1.0 + np.cos(np.pi * np.arange(len(patches)) / len(patches)))
    for first in range(0, len(patches), BLOCK):
        block, speed = patches[first : first + BLOCK], rates[first : first + BLOCK]
        short = BLOCK - len(block)
        # The last block is filled up with steps of length zero.
        block = np.concatenate([block, np.repeat(block[-1:], short, axis=0)])
        learning = take_steps(model, learning, data, block, np.pad(speed, (0, short)))
        if progress is not None:
            progress(int(sweeps * min(first + BLOCK, len(patches)) / len(patches)), None)
    hyper = np.exp(np.asarray(learning.hyper))
    values = {name: np.array(hyper[i]) for i, name in enumerate(HYPER)}
    return {**values, "x": np.asarray(learning.x)}


def fit_local(
    model: GaitPose,
    motion: xr.Dataset,
    *,
    seed: int = 0,
    sweeps: int = 40,
    patch: int = PATCH,
    rate: float = 0.03,
    preparation: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit a gait-pose model by local learning, from the ideal surface on.

    Parameters
    ----------
    model
        A model with points free around a surface, without dynamics.
    motion
        Training cycles.
    seed, sweeps, patch, rate, progress
        As in `learn_locally`.
    preparation
        Keywords of the model's `prepare`: the scales of the layers.

    Raises
    ------
    InputError
        As `learn_locally` and the model's `prepare`.
    """
    began = time.perf_counter()
    preparation = dict(preparation or {})
    training = model.prepare(motion, **preparation)
    start = model.initial_values(training, seed, 1)[0]
    _check(model, training.frames)
    values = learn_locally(
        model,
        training.frames,
        training.ideal(),
        start,
        seed=seed,
        sweeps=sweeps,
        patch=patch,
        rate=rate,
        progress=progress,
    )
    density = ProgramDensity(model)
    real = density.real(values, training.data)
    found = float(jax.jit(density)(real, training.data))
    require_finite(found, "y")
    settings = {"sweeps": sweeps, "patch": patch, "rate": rate}
    seconds = time.perf_counter() - began
    record = Record("local", settings, preparation, seed, seconds)
    draws = {name: np.asarray(value)[None, None] for name, value in values.items()}
    stats = {"lp": np.array([[found]]), "sweeps": np.array([[sweeps]])}
    return make_fit(model, motion, training, draws, stats, record)


def begin(start: dict[str, np.ndarray]) -> Learning:
    """Give the learning that begins at these site values."""
    x = jnp.asarray(start["x"], float)
    hyper = jnp.log(jnp.array([float(start[name]) for name in HYPER]))
    return Learning(
        x, jnp.zeros((2, *x.shape)), jnp.zeros(len(x)), hyper, jnp.zeros((2, len(HYPER))),
        jnp.zeros(()),
    )  # fmt: skip


def _check(model: GaitPose, cycles: Cycles) -> None:
    if model.dynamics or model.on or model.surface == "none":
        raise InputError(
            f"model {model}",
            "local learning cuts a surface with free points into patches, and paths into pieces",
            "Use a model with points free around a surface, without dynamics, or fit_map",
        )
    if not np.asarray(cycles.missing.rows).all():
        raise InputError(
            "training cycles", "entries are missing", "Use fit_map, or complete cycles"
        )


@partial(jax.jit, static_argnames="model", donate_argnames="learning")
def take_steps(
    model: GaitPose,
    learning: Learning,
    data: tuple,
    patches: Int[AnyArray, "steps m"],
    rates: Float[AnyArray, " steps"],
) -> Learning:
    """Take one step on each patch."""
    gradient = jax.grad(partial(patch_log_density, model), argnums=(0, 1))
    y, topology = data

    def one(learning: Learning, given):
        patch, rate = given
        x = learning.x[patch]
        beyond = learning.x[topology.neighbours[patch]]
        local = (y[patch], topology.neighbours[patch], topology.weights[:, patch], beyond, patch)
        on_x, on_hyper = gradient(x, learning.hyper, local, topology.constrained)
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
        ), None

    return jax.lax.scan(one, learning, (jnp.asarray(patches), jnp.asarray(rates)))[0]


def _adam(moments, gradient, count):
    """Give the new moments and the step of length about one that climbs."""
    first = FIRST * moments[0] + (1.0 - FIRST) * gradient
    second = SECOND * moments[1] + (1.0 - SECOND) * gradient**2
    mean, square = first / (1.0 - FIRST**count), second / (1.0 - SECOND**count)
    return jnp.stack([first, second]), mean / (jnp.sqrt(square) + TINY)


def patch_log_density(
    model: GaitPose,
    x: Float[AnyArray, "m q"],
    hyper: Float[AnyArray, " h"],
    local: tuple,
    constrained: Float[AnyArray, " q"],
) -> Float[Array, ""]:
    """Log density of a patch (eq. 14) up to a constant.

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
    points = {"x": x}
    K = model.kernel(values).matrix(points, points) + jnp.eye(x.shape[0]) / values["beta"]
    likelihood = log_density(y, K, jnp.ones(y.shape[1]), complete(*y.shape))
    # Neighbours in the patch move with it, those beyond stay where they are.
    same = neighbours[:, :, None] == patch
    inside = jnp.any(same, axis=-1)[..., None]
    near = jnp.where(inside, x[jnp.argmax(same, axis=-1)], jax.lax.stop_gradient(beyond))
    strayed = (x - jnp.einsum("qmk,mkq->mq", weights, near)) * constrained
    surface = -jnp.sum(strayed**2) / model.sigma**2 - 0.5 * jnp.sum(x**2) / model.breadth**2
    return likelihood + surface + log_hyperprior(values)
