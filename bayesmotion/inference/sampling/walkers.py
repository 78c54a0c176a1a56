"""Ensemble sampling of a log density of few unknowns, with emcee.

W walkers move together; each proposes a point by where some of the others are, so no
scale and no gradient is needed, and modes that walkers have found are jumped between:

    differential evolution   x + gamma (x_a - x_b)     ter Braak (2006)
    the same as a snooker    along x - x_c             ter Braak and Vrugt (2008)
    stretch                  x_a + z (x - x_a)         Goodman and Weare (2010)

Walkers depend on each other. They are one chain, not W: there is no R-hat over them,
and what W x S points are worth is told by the integrated autocorrelation time tau of
the ensemble (Goodman and Weare 2010): W S / tau independent draws.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import emcee
import numpy as np
from jaxtyping import Float

from ...errors import InputError, NumericalError
from ...gp.linalg import AnyArray

# With more unknowns proposals of this kind are hardly ever accepted.
MOST_UNKNOWNS = 60
# An estimated tau can be trusted when the chain is so many times as long (emcee's advice).
LENGTHS = 50
BLOCK = 50

Vectorised = Callable[[Float[np.ndarray, "w n"]], AnyArray]
Progress = Callable[[int, float], None]


class EnsembleState(NamedTuple):
    """Where an ensemble stands: walkers (W, n), their log densities, the random numbers' state."""

    walkers: Float[np.ndarray, "w n"]
    log_density: Float[np.ndarray, " w"]
    random: tuple


@dataclass(frozen=True)
class Ensemble:
    """S steps of W walkers in n unknowns.

    values
        (S, W, n).
    log_density
        (S, W).
    acceptance
        Share of proposals accepted.
    autocorrelation
        (n,) integrated autocorrelation time of every unknown, in steps.
    """

    values: Float[np.ndarray, "s w n"]
    log_density: Float[np.ndarray, "s w"]
    acceptance: float
    autocorrelation: Float[np.ndarray, " n"]

    @property
    def ess(self) -> Float[np.ndarray, " n"]:
        """How many independent draws the points are worth, for every unknown."""
        steps, walkers, _ = self.values.shape
        return steps * walkers / self.autocorrelation

    @property
    def trusted(self) -> bool:
        """Whether the run is long enough for its autocorrelation time to be believed."""
        return bool(np.all(len(self.values) >= LENGTHS * self.autocorrelation))

    def places(self, count: int) -> np.ndarray:
        """Give the places of `count` points among all S W: all walkers at steps far apart."""
        steps, walkers = self.log_density.shape
        rows = np.linspace(0, steps - 1, min(-(-count // walkers), steps)).round().astype(int)
        everyone = (rows[:, None] * walkers + np.arange(walkers)).ravel()
        return everyone[np.linspace(0, len(everyone) - 1, count).round().astype(int)]

    def draws(self, count: int) -> Float[np.ndarray, "d n"]:
        """Give `count` points: those of all walkers at steps far apart."""
        return self.values.reshape(-1, self.values.shape[-1])[self.places(count)]


def sample_ensemble(
    log_density: Vectorised,
    starts: Float[np.ndarray, "w n"],
    *,
    warmup: int,
    steps: int,
    seed: int,
    progress: Progress | None = None,
) -> Ensemble:
    """Sample a log density.

    Parameters
    ----------
    log_density
        Of all walkers at once, (W, n) to (W,); NaN counts as impossible.
    starts
        (W, n) where the walkers begin: an even number of them, at least twice as many
        as there are unknowns, in no common plane, each with a finite log density.
    warmup, steps
        Steps of the whole ensemble that are thrown away first, and that are kept.
    progress
        Called with the steps done and the best log density.

    Raises
    ------
    InputError
        If there are too many unknowns or too few walkers.
    NumericalError
        If a start has no finite log density.
    """
    run = EnsembleRun(log_density, starts.shape)
    state, blocks, done = run.begin(starts, seed), [], 0
    while done < warmup + steps:
        count = min(BLOCK, warmup - done if done < warmup else warmup + steps - done)
        state, block = run.advance(state, count)
        if done >= warmup:
            blocks.append(block)
        done += count
        if progress is not None:
            progress(done, float(state.log_density.max()))
    return together(blocks)


class Steps(NamedTuple):
    """Consecutive steps: walkers (S, W, n), log densities (S, W), proposals accepted (S,)."""

    values: Float[np.ndarray, "s w n"]
    log_density: Float[np.ndarray, "s w"]
    accepted: Float[np.ndarray, " s"]


def together(blocks: Sequence[Steps]) -> Ensemble:
    """Put the steps of an ensemble together with their autocorrelation time."""
    values, log_density, accepted = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    tau = autocorrelation_time(values)
    return Ensemble(values, log_density, float(np.mean(accepted)), tau)


def autocorrelation_time(values: Float[np.ndarray, "s w n"]) -> Float[np.ndarray, " n"]:
    """Integrated autocorrelation time of every unknown, in steps, at least one.

    Infinite where a chain has not moved at all.
    """
    if len(values) < 2:
        return np.full(values.shape[2], np.inf)
    still = np.all(values == values[:1], axis=(0, 1))
    moved = np.where(still, np.random.default_rng(0).normal(size=values.shape), values)
    tau = np.asarray(emcee.autocorr.integrated_time(moved, tol=0, quiet=True))
    return np.where(still | ~np.isfinite(tau), np.inf, np.maximum(tau, 1.0))


class EnsembleRun:
    """An ensemble that goes on step by step from any state.

    Parameters
    ----------
    log_density
        As in `sample_ensemble`.
    shape
        (W, n).
    """

    def __init__(self, log_density: Vectorised, shape: tuple[int, ...]) -> None:
        walkers, unknowns = shape
        if unknowns > MOST_UNKNOWNS:
            raise InputError(
                "ensemble",
                f"there are {unknowns} unknowns, and walkers get lost among more than "
                f"{MOST_UNKNOWNS}",
                "Use nuts",
            )
        if walkers < 2 * unknowns or walkers % 2:
            raise InputError(
                "ensemble",
                f"there are {walkers} walkers for {unknowns} unknowns",
                f"Take an even number, at least {2 * unknowns}",
            )
        self._log_density = log_density
        moves = [
            (emcee.moves.DEMove(), 0.7),
            (emcee.moves.DESnookerMove(), 0.1),
            (emcee.moves.StretchMove(), 0.2),
        ]
        self._sampler = emcee.EnsembleSampler(
            walkers, unknowns, self._finite, moves=moves, vectorize=True
        )

    def begin(self, starts: Float[np.ndarray, "w n"], seed: int) -> EnsembleState:
        """Evaluate the starts."""
        log_density = self._finite(starts)
        if not np.all(np.isfinite(log_density)):
            raise NumericalError(
                f"{int(np.sum(~np.isfinite(log_density)))} of {len(starts)} starts of the "
                "ensemble have no finite log density. Start closer to the mode."
            )
        random = np.random.RandomState(np.random.MT19937(np.random.SeedSequence(seed)))
        return EnsembleState(starts, log_density, random.get_state(legacy=True))

    def advance(self, state: EnsembleState, count: int) -> tuple[EnsembleState, Steps]:
        """Move every walker `count` times."""
        at = emcee.State(state.walkers, log_prob=state.log_density, random_state=state.random)
        moves = self._sampler.sample(
            at, iterations=count, store=False, skip_initial_state_check=True
        )
        last, values, densities, accepted = state.walkers, [], [], []
        for at in moves:
            values.append(np.array(at.coords))
            densities.append(np.array(at.log_prob))
            accepted.append(np.mean(np.any(values[-1] != last, axis=1)))
            last = values[-1]
        steps = Steps(np.array(values), np.array(densities), np.array(accepted))
        random = cast(tuple, at.random_state)
        return EnsembleState(last, steps.log_density[-1], random), steps

    def _finite(self, walkers: Float[np.ndarray, "w n"]) -> Float[np.ndarray, " w"]:
        values = np.asarray(self._log_density(walkers))
        return np.where(np.isnan(values), -np.inf, values)


def random_arrays(random: tuple) -> Mapping[str, np.ndarray]:
    """Give the random numbers' state as arrays."""
    name, keys, *rest = random
    assert name == "MT19937"
    return {"random_keys": np.asarray(keys), "random_rest": np.asarray(rest, dtype=float)}


def random_state(arrays: Mapping[str, np.ndarray]) -> tuple:
    """Undo `random_arrays`."""
    position, has_gauss, gauss = arrays["random_rest"]
    return ("MT19937", arrays["random_keys"], int(position), int(has_gauss), float(gauss))
