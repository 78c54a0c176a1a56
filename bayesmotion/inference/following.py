"""A clip followed frame by frame: its unknowns kept at their modes, its next frames predicted.

The unknowns u of a clip (phase, pace, styles, residual) have a posterior that changes little from
frame to frame. `HYPOTHESES` modes of it, for the draw of the fit of highest density, are kept:

- with a frame each is moved to the new middle of the window, and takes one step of Newton's
  method, of at most `LONGEST` standard deviations, which is not taken where the density would
  be less; then a shorter one is tried with the next frame;
- the curvature, which such steps need, is found anew for one hypothesis a frame, in turn;
- of two that come together one is dropped, and modes weigh by the mass about them (Laplace);
- while no frame is gone from the window, new ones begin with the frames `BEGIN`, in the place
  of the least likely.

Every component of a prediction has a draw of the fit, a hypothesis by their weights, and its own
mode, which begins at that of the hypothesis, goes with it, and takes such a step with every
`TURNS`-th frame. It is predicted at u drawn about the mode from N(mode, curvature^-1); where the
density there is less than such a normal has it, by a factor exp(`FAR`), nearer to it. Components
count alike: of one draw of a fit they share the hypotheses' modes. Random numbers are the same
for every frame: what changes between two forecasts is due to the frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float, Int

from ..verbs import Arrival, FollowedProgram, Follower
from .density import ProgramDensity, real_values
from .draws import draw_keys, on_device
from .optimisation.optimise import Unravel, flattened

HYPOTHESES, KEPT = 6, 3
BEGIN = (2, 4, 8, 16)
LONGEST, SAME, NEGLIGIBLE = 30.0, 0.5, 20.0
# Standard deviations before the curvature is known, and the least curvature.
ROUGH, LEAST_CURVATURE, STIFF = 0.1, 0.3, 1e8
# Parts of a step by a hypothesis' own curvature that are tried, and the shortest part of others.
TRIED = (1.0, 0.3, 0.1, 0.01, 0.0)
SHORTEST = 0.01
# A component's mode takes a step with every so many frames.
TURNS = 4
# How much less the log density may be than that of a normal posterior, and how draws come nearer
# to their mode where it is, and go away again.
FAR, NEARER, FARTHER = 2.0, 0.5, 1.2
# Components, at least: of unknowns drawn about their modes, or of the modes alone.
COMPONENTS, FEWEST = 16, 8


# Those of a trained model.
Leaves = tuple[Array, ...]


class Modes(NamedTuple):
    """K modes on the real line; `past` has a leading axis.

    at, step
        (K, m), and what part of a step is tried.
    """

    at: Float[Array, "k m"]
    step: Float[Array, " k"]
    past: Any


class State(NamedTuple):
    """What is kept from frame to frame.

    bank, factor
        K hypotheses, and roots (K, m, m) of their covariances.
    mass, curved
        (K,) logarithms of the mass about them, and which covariances have been found.
    own, of
        Modes of the components, None where there is one draw, and which hypothesis (L,) each
        is of.
    reach
        (L,) how far components are drawn from their modes, 1 for all of a normal's way.
    """

    bank: Modes
    factor: Float[Array, "k m m"]
    mass: Float[Array, " k"]
    curved: Float[Array, " k"]
    own: Modes | None
    of: Int[Array, " l"]
    reach: Float[Array, " l"]


class Fixed(NamedTuple):
    """What does not change, of L components.

    best, draws
        Leaves of the trained model of the draw of highest density, and those of the components,
        (L, ...) where they differ; None where all are that one.
    white
        (L, m) standard normal numbers, zero for the modes themselves.
    place
        (L,) from 0 to 1: of which mode a component is.
    noise
        Random numbers of the joint draws, as `FollowedProgram.noise` makes them.
    location, scale
        Units of what is predicted.
    """

    best: Leaves
    draws: Leaves | None
    white: Float[Array, "l m"]
    place: Float[Array, " l"]
    noise: Any
    location: Float[Array, " d"]
    scale: Float[Array, " d"]


class Said(NamedTuple):
    """What is said of the N frames that follow, by L components.

    mean, sd
        (L, N, D) of every entry.
    sample
        (L, N, D) joint draws.
    unknowns
        Those of the components (L, ...).
    mode
        Those at the mode of most mass.
    """

    mean: Array
    sd: Array
    sample: Array
    unknowns: dict[str, Array]
    mode: dict[str, Array]


@dataclass(frozen=True)
class _Density:
    """Log density of the unknowns on the real line, for one set of them; hashable.

    Trained models are given by their leaves, of which those of all draws differ where `axes` are 0.
    """

    process: FollowedProgram
    unravel: Unravel
    structure: Any
    axes: tuple[int | None, ...]

    @property
    def program(self) -> ProgramDensity:
        return ProgramDensity(self.process, jacobian=True)

    def __call__(self, at: Array, window: Any, past: Any, leaves: Leaves) -> Array:
        return self.program(self.unravel(at), (window, past, self.trained(leaves)))

    def natural(self, at: Array, window: Any, past: Any, leaves: Leaves) -> dict[str, Array]:
        return self.program.natural(self.unravel(at), (window, past, self.trained(leaves)))

    def trained(self, leaves: Leaves) -> Any:
        """Return the trained model with these leaves."""
        return jax.tree.unflatten(self.structure, leaves)

    def some(self, draws: Leaves, lanes: Array) -> Leaves:
        """Return the trained models of some components."""
        parts = zip(draws, self.axes, strict=True)
        return tuple(leaf if axis is None else leaf[lanes] for leaf, axis in parts)

    def invariant(self, at: Array) -> list[Array]:
        """Return directions in which what frames say does not change."""
        return [_flat(one) for one in self.process.invariant(self.unravel(at))]

    def moved(
        self, at: Array, data: tuple, new: Any, shift: Array, left: tuple | None
    ) -> tuple[Array, Any]:
        """Return unknowns and past with a new window, whose middle is so much later."""
        window, past, leaves = data
        own, trained = self.natural(at, *data), self.trained(leaves)
        if left is not None:
            parent, seen, group = left
            past = self.process.gone(window, past.split(parent), trained, own, seen, group)
        real = self.program.real(self.process.moved(own, shift), (new, past, trained))
        return _flat(real), past


class Tracker:
    """The unknowns of a clip, and what is to come of it.

    Parameters
    ----------
    follower
        The clip before its first frame.
    training
        The argument of the program of the training data.
    values
        Draws (S, ...) of the fit.
    best
        That of highest density.
    about
        How many draws of the unknowns are averaged over; 0 for the modes alone.
    seed
        Of random numbers.
    """

    def __init__(
        self,
        follower: Follower,
        training: Any,
        values: Mapping[str, Array],
        best: int,
        about: int,
        seed: int,
    ) -> None:
        self.follower, self.frames = follower, 0
        count = len(next(iter(values.values())))
        each = [
            _condition(follower.process, training, {n: v[index] for n, v in values.items()})
            for index in range(count)
        ]
        self._trained = each[best]
        leaves = [jax.tree.leaves(one) for one in each]
        self._structure = jax.tree.structure(self._trained)
        # What all draws share, such as the training frames, is kept once.
        self._axes = tuple(
            None if all(np.array_equal(one, of[0]) for one in of[1:]) else 0
            for of in zip(*leaves, strict=True)
        )
        components = count * -(-(min(about, COMPONENTS) or FEWEST) // count)
        keys = draw_keys(seed, values)[jnp.arange(components) % count]
        self._keys = jax.vmap(jax.random.fold_in)(keys, jnp.arange(components) // count)
        # Whatever the order of the draws, each has its place among the modes.
        order = np.asarray(jax.vmap(jax.random.uniform)(self._keys))
        self._place = (np.argsort(np.argsort(order)) + 0.5) / components
        self._draws = None
        if count > 1:
            chosen = [leaves[index % count] for index in range(components)]
            self._draws = tuple(
                of[0] if axis is None else jnp.stack(of)
                for of, axis in zip(zip(*chosen, strict=True), self._axes, strict=True)
            )
        self._about, self._window = about, None
        self._density: _Density | None = None
        self._state: State | None = None
        self._fixed: Fixed | None = None

    def add(self, frame: xr.Dataset) -> Said | None:
        """Return what is said of the next frames after one more; of the first alone nothing."""
        arrival: Arrival = self.follower.add(frame)
        self.frames += 1
        if self.frames < BEGIN[0]:
            return None
        window = on_device(arrival.window)
        fresh = None
        if self.frames in BEGIN and arrival.left is None:
            fresh = self._fresh(window)
        assert self._state is not None, "the first frame begins"
        state = self._state
        if self._window is not None:
            data = (self._fixed, self._window, window, on_device(arrival.left))
            state = _moved(self._density, state, *data, np.float64(arrival.shift))
        if fresh is not None:
            state = _begun(state, fresh)
        self._state, said = _advance(
            self._density, state, self._fixed, window, np.int32(self.frames)
        )
        self._window = window
        return said

    def _fresh(self, window: Any) -> Float[np.ndarray, "j m"]:
        """Return where hypotheses begin, in the place of the least likely: all at first."""
        count = HYPOTHESES if self._state is None else HYPOTHESES - KEPT
        found = self.follower.candidates(self._trained, count)
        process = self.follower.process
        past = process.nothing(self._trained)
        density = ProgramDensity(process, jacobian=True)
        real = [real_values(density, one, (window, past, self._trained)) for one in found]
        at = np.stack([flattened(one) for one in real])
        at = np.resize(at, (count, at.shape[1]))
        if self._state is None:
            density = _Density(process, Unravel(real[0]), self._structure, self._axes)
            self._first(density, at, past, window)
        return at

    def _first(
        self, density: _Density, at: Float[np.ndarray, "k m"], past: Any, window: Any
    ) -> None:
        size, components = at.shape[1], len(self._place)

        def modes(count: int) -> Modes:
            pasts = jax.tree.map(lambda leaf: np.stack([leaf] * count), past)
            return Modes(jnp.zeros((count, size)) + at[0], jnp.ones(count), pasts)

        self._density = density
        self._state = on_device(State(
            modes(HYPOTHESES), jnp.stack([ROUGH * jnp.eye(size)] * HYPOTHESES),
            jnp.full(HYPOTHESES, -jnp.inf), jnp.zeros(HYPOTHESES),
            None if self._draws is None else modes(components), jnp.full(components, -1),
            jnp.ones(components),
        ))  # fmt: skip
        white = jax.vmap(lambda key: jax.random.normal(key, (size,)))(self._keys)
        noise = jax.vmap(self.follower.process.noise, (None, 0))(window, self._keys)
        units = self.follower.units
        self._fixed = Fixed(
            tuple(jax.tree.leaves(self._trained)), self._draws, white * float(self._about > 0),
            jnp.asarray(self._place), noise, jnp.asarray(units.location), jnp.asarray(units.scale),
        )  # fmt: skip


def _flat(values: Mapping[str, Array]) -> Float[Array, " m"]:
    return jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(dict(values))])


@partial(jax.jit, static_argnames="process")
def _condition(process: Any, frames: Any, values: dict[str, Array]) -> Any:
    return process.condition(frames, values)


@partial(jax.jit, static_argnames="density")
def _moved(
    density: _Density,
    state: State,
    fixed: Fixed,
    before: Any,
    window: Any,
    left: tuple | None,
    shift: Array,
) -> State:
    """Return the modes at the middle of a new window, what has left it being gone."""

    def one(at: Array, past: Any, trained: Any) -> tuple[Array, Any]:
        return density.moved(at, (before, past, trained), window, shift, left)

    def all_of(modes: Modes, trained: Any) -> Modes:
        shared = None if trained is fixed.best else density.axes
        at, past = jax.vmap(one, (0, 0, shared))(modes.at, modes.past, trained)
        return Modes(at, modes.step, past)

    own = None if state.own is None else all_of(state.own, fixed.draws)
    return state._replace(bank=all_of(state.bank, fixed.best), own=own)


@jax.jit
def _begun(state: State, fresh: Array) -> State:
    """Return the hypotheses with fresh ones in the place of the least likely."""
    lanes = jnp.argsort(state.mass)[: len(fresh)]
    bank = state.bank._replace(
        at=state.bank.at.at[lanes].set(fresh), step=state.bank.step.at[lanes].set(1.0)
    )
    factor = state.factor.at[lanes].set(ROUGH * jnp.eye(fresh.shape[1]))
    of = jnp.where(jnp.isin(state.of, lanes), -1, state.of)
    return state._replace(bank=bank, factor=factor, curved=state.curved.at[lanes].set(0.0), of=of)


@partial(jax.jit, static_argnames="density")
def _advance(
    density: _Density, state: State, fixed: Fixed, window: Any, frame: Array
) -> tuple[State, Said]:
    """Return the state after a frame, and what is said of the frames that follow."""

    def climbed(modes: Modes, factor: Array, trained: Any) -> tuple[Modes, Array]:
        def one(modes: Modes, factor: Array, trained: Any) -> tuple[Modes, Array]:
            return _climbed(density, modes, factor, (window, modes.past, trained))

        shared = None if trained is fixed.best else density.axes
        return jax.vmap(one, (0, 0, shared))(modes, factor, trained)

    bank, factor, curved = _curved(density, state, fixed, window, frame)
    bank, value = climbed(bank, factor, fixed.best)
    mass = _masses(bank.at, value, factor, curved)
    weight = jnp.exp(mass - jnp.max(mass))
    edges = jnp.cumsum(weight) / jnp.sum(weight)
    of = jnp.minimum(jnp.searchsorted(edges, fixed.place), len(mass) - 1)
    modes, own, trained = _rows(bank, of), state.own, fixed.best
    if own is None:
        lanes, of_modes = jnp.arange(len(of)), value[of]
    else:
        assert fixed.draws is not None, "components have draws of their own"
        stays, trained = of == state.of, fixed.draws
        gone = bank.at - state.bank.at

        def kept(mine: Array, other: Array) -> Array:
            return jnp.where(stays.reshape(-1, *[1] * (other.ndim - 1)), mine, other)

        own = jax.tree.map(kept, own._replace(at=own.at + gone[of]), modes)
        lanes = (TURNS * jnp.arange(-(-len(of) // TURNS)) + frame % TURNS) % len(of)
        some, of_modes = climbed(
            _rows(own, lanes), factor[of[lanes]], density.some(fixed.draws, lanes)
        )
        own = modes = jax.tree.map(lambda all, part: all.at[lanes].set(part), own, some)
    reach = jnp.where(of == state.of, state.reach, 1.0)
    there = modes.at + reach[:, None] * jnp.einsum("lij,lj->li", factor[of], fixed.white)
    near = _nearer(density, window, fixed, _rows((there, modes.past, reach), lanes),
                   of_modes, lanes)  # fmt: skip
    reach = reach.at[lanes].set(near)
    there = modes.at + reach[:, None] * jnp.einsum("lij,lj->li", factor[of], fixed.white)
    said = _said(density, fixed, window, there, modes.past, trained)
    best = jnp.argmax(mass)
    mode = density.natural(bank.at[best], window, _rows(bank.past, best), fixed.best)
    return State(bank, factor, mass, curved, own, of, reach), said._replace(mode=mode)


def _rows[T](tree: T, rows: Array) -> T:
    return jax.tree.map(lambda leaf: leaf[rows], tree)


def _curved(
    density: _Density, state: State, fixed: Fixed, window: Any, frame: Array
) -> tuple[Modes, Float[Array, "k m m"], Float[Array, " k"]]:
    """Return the hypotheses, one after a step by its own curvature, and their covariances."""
    rank = jnp.where(frame % 2 == 0, 0, 1 + frame // 2 % (len(state.mass) - 1))
    lane = jnp.argsort(-state.mass)[rank]
    at, past = _rows((state.bank.at, state.bank.past), lane)
    data = (window, past, fixed.best)
    root = _root(density, at, data)
    white = root.T @ jax.grad(density)(at, *data)
    white = white * jnp.minimum(1.0, LONGEST / jnp.linalg.norm(white))
    tried = at + jnp.asarray(TRIED)[:, None] * (root @ white)
    found = jax.vmap(lambda at: density(at, *data))(tried)
    best = jnp.argmax(jnp.where(jnp.isfinite(found), found, -jnp.inf))
    bank = state.bank._replace(
        at=state.bank.at.at[lane].set(tried[best]), step=state.bank.step.at[lane].set(1.0)
    )
    return bank, state.factor.at[lane].set(root), state.curved.at[lane].set(1.0)


def _nearer(
    density: _Density, window: Any, fixed: Fixed, drawn: tuple, value: Array, lanes: Array
) -> Float[Array, " p"]:
    """Return how far some components are to be drawn from their modes, by the density there."""
    trained = fixed.best if fixed.draws is None else density.some(fixed.draws, lanes)
    shared = None if fixed.draws is None else density.axes

    def one(there: Array, past: Any, reach: Array, value: Array, white: Array, trained: Any):
        away = density(there, window, past, trained) - value + 0.5 * reach**2 * jnp.sum(white**2)
        farther = jnp.where(away > -0.5 * FAR, jnp.minimum(FARTHER * reach, 1.0), reach)
        return jnp.where(away > -FAR, farther, NEARER * reach)

    there, past, reach = drawn
    return jax.vmap(one, (0, 0, 0, 0, 0, shared))(
        there, past, reach, value, fixed.white[lanes], trained
    )


def _climbed(density: _Density, modes: Modes, factor: Array, data: tuple) -> tuple[Modes, Array]:
    """Return one mode after a step of Newton's method, and the density there."""
    value, slope = jax.value_and_grad(density)(jnp.asarray(modes.at), *data)
    white = factor.T @ slope
    white = white * jnp.minimum(1.0, LONGEST / jnp.linalg.norm(white))
    there = modes.at + modes.step * factor @ white
    after = density(there, *data)
    better = after >= value
    step = jnp.where(better, jnp.minimum(1.0, 4.0 * modes.step), 0.25 * modes.step)
    at = jnp.where(better, there, modes.at)
    return Modes(at, jnp.maximum(step, SHORTEST), modes.past), jnp.where(better, after, value)


def _root(density: _Density, at: Array, data: tuple) -> Float[Array, "m m"]:
    """Return the symmetric root of the covariance that the curvature tells."""
    curvature = -jax.hessian(density)(at, *data)
    finite = jnp.where(jnp.isfinite(curvature), curvature, jnp.eye(len(at)))
    # Where what frames say does not change there is nothing to tell, and lines leave the curves.
    for flat in density.invariant(at):
        finite = finite + STIFF * jnp.outer(flat, flat) / jnp.sum(flat**2)
    values, vectors = jnp.linalg.eigh(0.5 * (finite + finite.T))
    return (vectors / jnp.sqrt(jnp.maximum(jnp.abs(values), LEAST_CURVATURE))) @ vectors.T


def _masses(at: Array, value: Array, factor: Array, curved: Array) -> Float[Array, " k"]:
    """Return the mass about each mode: none of those that are found again, or negligible."""
    size = jnp.linalg.slogdet(factor)[1]
    usual = jnp.sum(curved * size) / jnp.sum(curved)
    mass = value + jnp.where(curved > 0.0, size, usual)
    mass = jnp.where(jnp.isfinite(mass), mass, -jnp.inf)
    apart = jnp.linalg.solve(factor[:, None], (at[:, None] - at[None])[..., None])[..., 0]
    same = jnp.linalg.norm(apart, axis=2) < SAME
    rank = jnp.argsort(jnp.argsort(-mass))
    again = jnp.any(same & (rank[None] < rank[:, None]), axis=1)
    mass = jnp.where(again, -jnp.inf, mass)
    return jnp.where(mass > jnp.max(mass) - NEGLIGIBLE, mass, -jnp.inf)


def _said(
    density: _Density, fixed: Fixed, window: Any, there: Array, past: Any, trained: Any
) -> Said:
    """Return what the components say at these unknowns."""

    def one(at: Array, past: Any, noise: Any, trained: Any) -> tuple:
        own = density.natural(at, window, past, trained)
        given = density.trained(trained)
        return *density.process.predict(window, past, given, own, noise), own

    shared = None if trained is fixed.best else density.axes
    mean, variance, sample, own = jax.vmap(one, (0, 0, 0, shared))(
        there, past, fixed.noise, trained
    )
    location, scale = fixed.location, fixed.scale
    return Said(
        location + scale * mean, scale * jnp.sqrt(variance), location + scale * sample, own, {}
    )
