"""How new people differ from what a gait-pose model makes of them, learned by leaving out.

A process that was fitted to people goes through their poses; how far it will be from a
new person's is seen by taking one person's cycles out of what it is conditioned on,
and finding latent paths for them as for a new person: by all features, or by those that
will be seen of the new person too (`LeaveOneOut.residuals`). A path that has not seen an arm
is farther from it. Where the trained model has many draws, so it is for each of some of them.

Of these residuals, cycle by cycle and harmonic by harmonic, the distribution of
`pose_posterior` is made (`learn_subject_residual`): with v_kd the mean square of feature d's
harmonic k,

    P_kd = (1 - pooling) v_kd + pooling v_k v_d / v
    A    = (1 - shrinkage) S + shrinkage I

with S the correlations of the residuals in one band of harmonics. Pooling, shrinkage and the
sd of scales are, for each band by itself, those under which the people left out are
likeliest, v and S being those of the others; but where features are missing, the shrinkage
is that with which the others tell most of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int
from scipy.special import logsumexp

from ..errors import InputError
from ..gp.linalg import AnyArray
from ..models.gait_pose.data import Cycles
from ..models.gait_pose.harmonics import harmonics_of
from ..models.gait_pose.prediction import LatentGP
from ..verbs import ConditionsOnCycles
from .latent import KnownPaths, TrainingCycles, infer_path, known_paths, measured
from .pose_posterior import BANDS, LOG_SCALES, SubjectResidual, band_of, log_weights

FIRST_GUESS = 0.1  # of a mean square of one: the variance paths are found with at first
LEAST = 1e-3  # of the mean power: what angles that hardly move may move in somebody new
POOLINGS = (0.05, 0.3)
SHRINKAGES = (0.03, 0.05, 0.1, 0.2, 0.4, 0.7)
LOG_SCALE_SDS = (0.05, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0)


@dataclass(frozen=True)
class Residuals:
    """What is left of people who were left out.

    residual
        (C, T, D) features less the process's mean.
    variance
        Mean variance the process had there.
    subjects
        (C,) the person of each cycle.
    missing
        (M,) features that paths were found without.
    """

    residual: Float[np.ndarray, "c t d"]
    variance: float
    subjects: tuple[str, ...]
    missing: tuple[int, ...] = ()


class _WithoutOne(NamedTuple):
    """A draw of the trained model without a person, and where searches begin."""

    process: LatentGP
    known: KnownPaths


@dataclass(frozen=True)
class LeaveOneOut:
    """A trained model without each of its people.

    y
        (C, T, D) complete training cycles.
    subjects
        (C,) the person of each.
    draws
        For every draw, by person: conditioned on everybody else. Latent points and
        hyperparameters are those of all.
    """

    y: Float[np.ndarray, "c t d"]
    subjects: tuple[str, ...]
    draws: tuple[Mapping[str, _WithoutOne], ...]

    def residuals(self, missing: Sequence[int] = (), white: float = FIRST_GUESS) -> Residuals:
        """Return the residuals of every person's cycles without that person, of all draws.

        Parameters
        ----------
        missing
            Features that paths are found without.
        white
            Variance that paths are found with.
        """
        parts = [self._of_draw(draw, missing, white) for draw in self.draws]
        residual = np.concatenate([residual for residual, _ in parts])
        variance = float(np.mean([variance for _, variance in parts]))
        return Residuals(residual, variance, self.subjects * len(parts), tuple(missing))

    def _of_draw(
        self, draw: Mapping[str, _WithoutOne], missing: Sequence[int], white: float
    ) -> tuple[np.ndarray, float]:
        people = np.asarray(self.subjects)
        d = self.y.shape[2]
        seen = np.ones(self.y.shape[1:], bool)
        seen[:, list(missing)] = False
        residual, variances = np.empty_like(self.y), []
        for person, (process, known) in draw.items():
            for cycle in np.flatnonzero(people == person):
                given = measured(self.y[cycle], seen)
                path = infer_path(process, given, np.full(d, white), known=known)
                residual[cycle] = self.y[cycle] - path.mean
                variances.append(path.variance)
        return residual, float(np.mean(variances))


def leave_one_out(
    model: ConditionsOnCycles, training: TrainingCycles, draws: Sequence[Mapping[str, AnyArray]]
) -> LeaveOneOut:
    """Take every person out of draws of a trained model, in turn.

    Only cycles without missing entries tell how people differ.

    Raises
    ------
    InputError
        If fewer than two people have such cycles.
    """
    people = np.asarray(training.subjects * len(training.scales))
    whole = training.complete_cycles()
    known = tuple(dict.fromkeys(people[whole].tolist()))
    if len(known) < 2:
        raise InputError(
            "training cycles",
            f"complete ones are of {len(known)} people: how others differ cannot be told",
            "Train on complete cycles of two people at least",
        )

    def without(values: Mapping[str, AnyArray], person: str) -> _WithoutOne:
        process = _conditioned(model, training.frames, values, (people != person).astype(float))
        return _WithoutOne(process, known_paths(process))

    y = np.asarray(training.frames.y).reshape(len(people), training.poses, -1)
    return LeaveOneOut(
        y[whole],
        tuple(people[whole].tolist()),
        tuple({person: without(values, person) for person in known} for values in draws),
    )


@partial(jax.jit, static_argnames="model")
def _conditioned(
    model: ConditionsOnCycles,
    frames: Cycles,
    values: Mapping[str, AnyArray],
    cycles: Float[AnyArray, " c"],
) -> LatentGP:
    return model.condition_on_some(frames, values, cycles)


def learn_subject_residual(left: Residuals) -> SubjectResidual:
    """Return the distribution of residuals of people left out."""
    number, waves = harmonics_of(left.residual.shape[1])
    r = np.einsum("jt,ctd->cjd", waves, left.residual)
    people = np.asarray(left.subjects)
    every = _Moments.of(r, number)
    folds = [(r[people == one], _Moments.of(r[people != one], number))
             for one in dict.fromkeys(people)]  # fmt: skip
    power, correlation, sds = np.empty_like(every.v), [], []
    bands = band_of(np.arange(len(power)))
    for band in range(len(BANDS)):
        pooling, shrinkage, sd = _best(folds, number, band, left.missing)
        power[bands == band], own = every.shrunk(pooling, shrinkage, band)
        correlation.append(own)
        sds.append(sd)
    return SubjectResidual(power, np.stack(correlation), np.array(sds), np.asarray(left.variance))


def _best(
    folds: "list[tuple[np.ndarray, _Moments]]",
    number: Int[np.ndarray, " t"],
    band: int,
    missing: Sequence[int],
) -> tuple[float, float, float]:
    """Return pooling, shrinkage and sd of a band that are the best for people left out."""
    chosen = band_of(number) == band
    own = number[chosen] - number[chosen][0]
    likely, off = {}, {}
    for pooling, shrinkage in product(POOLINGS, SHRINKAGES):
        learned = [(out[:, chosen], *moments.shrunk(pooling, shrinkage, band), own)
                   for out, moments in folds]  # fmt: skip
        each = [_energies(*one) for one in learned]
        for sd in LOG_SCALE_SDS:
            likely[pooling, shrinkage, sd] = sum(_likelihood(*one, sd) for one in each)
        off[shrinkage] = sum(_square_off(*one, missing) for one in learned)
    if len(missing):
        best = min(off, key=lambda shrinkage: off[shrinkage])
        likely = {one: score for one, score in likely.items() if one[1] == best}
    return max(likely, key=lambda one: likely[one])


@dataclass(frozen=True)
class _Moments:
    """Mean squares v (K, D) of harmonics, and the correlations in each band."""

    v: Float[np.ndarray, "k d"]
    bands: Float[np.ndarray, "4 d d"]

    @classmethod
    def of(cls, r: Float[np.ndarray, "c t d"], number: Int[np.ndarray, " t"]) -> "_Moments":
        """Of harmonics (C, T, D)."""
        square = np.mean(r**2, axis=0)
        v = np.stack([square[number == k].mean(axis=0) for k in range(number[-1] + 1)])
        v = v + LEAST * v.mean(axis=1, keepdims=True)
        z = r / np.sqrt(v)[number]
        products = np.einsum("cta,ctb->tab", z, z, optimize=True)
        bands = band_of(number)
        each = [products[bands == band].sum(axis=0) for band in range(len(BANDS))]
        return cls(v, np.stack([_correlation(S) for S in each]))

    def shrunk(
        self, pooling: float, shrinkage: float, band: int
    ) -> tuple[Float[np.ndarray, "k d"], Float[np.ndarray, "d d"]]:
        """Power of the harmonics of a band, and their correlations."""
        v = self.v[band_of(np.arange(len(self.v))) == band]
        pooled = v.mean(axis=1, keepdims=True) * self.v.mean(axis=0) / self.v.mean()
        S = self.bands[band]
        correlation = (1.0 - shrinkage) * S + shrinkage * np.eye(len(S))
        return (1.0 - pooling) * v + pooling * pooled, correlation


def _correlation(S: Float[np.ndarray, "d d"]) -> Float[np.ndarray, "d d"]:
    size = np.sqrt(np.diag(S) + LEAST * np.mean(np.diag(S)))
    out = S / (size[:, None] * size)
    np.fill_diagonal(out, 1.0)
    return out


def _energies(
    r: Float[np.ndarray, "c t d"],
    power: Float[np.ndarray, "k d"],
    correlation: Float[np.ndarray, "d d"],
    number: Int[np.ndarray, " t"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Energy (C, K) of harmonics left out, how many numbers that is (K,), and log volumes."""
    L = np.linalg.cholesky(correlation)
    half = (r / np.sqrt(power[number])) @ np.linalg.inv(L).T
    energy = np.zeros((len(r), len(power)))
    np.add.at(energy.T, number, np.sum(half**2, axis=2).T)
    count = np.bincount(number)
    logdet = np.log(power).sum(axis=1) + 2.0 * np.sum(np.log(np.diag(L)))
    return energy, count * r.shape[2], logdet * count


def _square_off(
    r: Float[np.ndarray, "c t d"],
    power: Float[np.ndarray, "k d"],
    correlation: Float[np.ndarray, "d d"],
    number: Int[np.ndarray, " t"],
    missing: Sequence[int],
) -> float:
    """Square of how far missing features are from their mean given the others."""
    hidden = list(missing)
    seen = np.setdiff1d(np.arange(r.shape[2]), hidden)
    gain = np.linalg.solve(correlation[np.ix_(seen, seen)], correlation[np.ix_(seen, hidden)])
    root = np.sqrt(power[number])
    off = r[..., hidden] - ((r / root)[..., seen] @ gain) * root[:, hidden]
    return float(np.sum(off**2))


def _likelihood(
    energy: np.ndarray, numbers: np.ndarray, logdet: np.ndarray, log_scale_sd: float
) -> float:
    """Log density of harmonics left out up to a constant, over their scales."""
    weights = log_weights(np.full(len(numbers), log_scale_sd))
    scale = LOG_SCALES[:, None, None]
    each = -0.5 * energy * np.exp(-2.0 * scale) - scale * numbers + weights[:, None, :]
    over = np.asarray(logsumexp(each, axis=0))
    return float(np.sum(over) - 0.5 * len(energy) * np.sum(logdet))
