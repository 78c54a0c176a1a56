"""How new people differ from what a gait-pose model makes of them, learned by leaving out.

A process that was fitted to people goes through their poses; how far it will be from a
new person's is seen by taking one person's cycles out of what it is conditioned on,
and finding latent paths for them as for a new person: by all features, or by those that
will be seen of the new person too (`WithoutOne.left_over`). A path that has not seen an arm is
farther from it.

Of what is left over, cycle by cycle and wave by wave, the distribution of
`pose_posterior` is made (`learn_deviation`): with v_kd the mean square of feature d's
waves that turn k times,

    P_kd = (1 - pooling) v_kd + pooling v_k v_d / v
    A    = (1 - shrinkage) S + shrinkage I

with S the correlations of what is left over, of one kind of waves. Pooling, shrinkage and the
spread of scales are, for each kind by itself, those under which the people left out are
likeliest, v and S being those of the others; but where features are missing, the shrinkage
is that with which the others tell most of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float, Int
from scipy.special import logsumexp

from ..gp.linalg import AnyArray
from ..models.gait_cycles import GaitTraining
from ..models.gait_pose import GaitPose
from ..models.latent_gp import LatentGP
from .latent import candidates_of, measured, represent
from .pose_posterior import KINDS, LOG_SCALES, Deviation, kind_of, log_weights, waves_of

FIRST_GUESS = 0.1  # of a mean square of one: the variance paths are found with at first
LEAST = 1e-3  # of the mean power: what angles that hardly move may move in somebody new
POOLINGS = (0.05, 0.3)
SHRINKAGES = (0.03, 0.05, 0.1, 0.2, 0.4, 0.7)
SPREADS = (0.05, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0)


@dataclass(frozen=True)
class LeftOver:
    """What is left over of people who were left out.

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


@dataclass(frozen=True)
class WithoutOne:
    """A trained model without each of its people.

    y
        (C, T, D) training cycles.
    subjects
        (C,) the person of each.
    processes
        By person: conditioned on everybody else. Latent points and hyperparameters are those
        of all.
    """

    y: Float[np.ndarray, "c t d"]
    subjects: tuple[str, ...]
    processes: Mapping[str, LatentGP]

    def left_over(self, missing: Sequence[int] = (), white: float = FIRST_GUESS) -> LeftOver:
        """Represent every person's cycles without that person.

        Parameters
        ----------
        missing
            Features that paths are found without.
        white
            Variance that paths are found with.
        """
        people = np.asarray(self.subjects)
        d = self.y.shape[2]
        seen = np.ones(self.y.shape[1:], bool)
        seen[:, list(missing)] = False
        residual, variances = np.empty_like(self.y), []
        for person, process in self.processes.items():
            known = candidates_of(process)
            for cycle in np.flatnonzero(people == person):
                given = measured(self.y[cycle], seen)
                found = represent(process, given, np.full(d, white), candidates=known)
                residual[cycle] = self.y[cycle] - found.mean
                variances.append(found.variance)
        return LeftOver(residual, float(np.mean(variances)), self.subjects, tuple(missing))


def without_each(
    model: GaitPose, training: GaitTraining, values: Mapping[str, AnyArray]
) -> WithoutOne:
    """Take every person out of a trained model, its data and its sites, in turn."""
    subjects = tuple(training.subjects) * len(training.scales)
    people = np.asarray(subjects)
    processes = {
        person: model.given_some(training.frames, values, np.flatnonzero(people != person))
        for person in dict.fromkeys(subjects)
    }
    y = np.asarray(training.frames.y).reshape(len(people), training.poses, -1)
    return WithoutOne(y, subjects, processes)


def learn_deviation(left: LeftOver) -> Deviation:
    """Give the distribution of what was left over."""
    turns, waves = waves_of(left.residual.shape[1])
    r = np.einsum("jt,ctd->cjd", waves, left.residual)
    people = np.asarray(left.subjects)
    every = _Moments.of(r, turns)
    folds = [(r[people == one], _Moments.of(r[people != one], turns))
             for one in dict.fromkeys(people)]  # fmt: skip
    power, alike, spreads = np.empty_like(every.v), [], []
    kinds = kind_of(np.arange(len(power)))
    for kind in range(len(KINDS)):
        pooling, shrinkage, spread = _best(folds, turns, kind, left.missing)
        power[kinds == kind], own = every.shrunk(pooling, shrinkage, kind)
        alike.append(own)
        spreads.append(spread)
    return Deviation(power, np.stack(alike), np.array(spreads), np.asarray(left.variance))


def _best(
    folds: "list[tuple[np.ndarray, _Moments]]",
    turns: Int[np.ndarray, " t"],
    kind: int,
    missing: Sequence[int],
) -> tuple[float, float, float]:
    """Pooling, shrinkage and spread of a kind that are the best for people left out."""
    chosen = kind_of(turns) == kind
    own = turns[chosen] - turns[chosen][0]
    likely, off = {}, {}
    for pooling, shrinkage in product(POOLINGS, SHRINKAGES):
        learned = [(out[:, chosen], *moments.shrunk(pooling, shrinkage, kind), own)
                   for out, moments in folds]  # fmt: skip
        each = [_energies(*one) for one in learned]
        for spread in SPREADS:
            likely[pooling, shrinkage, spread] = sum(_likelihood(*one, spread) for one in each)
        off[shrinkage] = sum(_square_off(*one, missing) for one in learned)
    if len(missing):
        best = min(off, key=lambda shrinkage: off[shrinkage])
        likely = {one: score for one, score in likely.items() if one[1] == best}
    return max(likely, key=lambda one: likely[one])


@dataclass(frozen=True)
class _Moments:
    """Mean squares v (K, D) of waves, and the correlations of each kind."""

    v: Float[np.ndarray, "k d"]
    kinds: Float[np.ndarray, "4 d d"]

    @classmethod
    def of(cls, r: Float[np.ndarray, "c t d"], turns: Int[np.ndarray, " t"]) -> "_Moments":
        """Of waves (C, T, D)."""
        square = np.mean(r**2, axis=0)
        v = np.stack([square[turns == k].mean(axis=0) for k in range(turns[-1] + 1)])
        v = v + LEAST * v.mean(axis=1, keepdims=True)
        z = r / np.sqrt(v)[turns]
        products = np.einsum("cta,ctb->tab", z, z, optimize=True)
        kinds = kind_of(turns)
        each = [products[kinds == kind].sum(axis=0) for kind in range(len(KINDS))]
        return cls(v, np.stack([_correlation(S) for S in each]))

    def shrunk(
        self, pooling: float, shrinkage: float, kind: int
    ) -> tuple[Float[np.ndarray, "k d"], Float[np.ndarray, "d d"]]:
        """Power of the waves of a kind, and their correlations."""
        v = self.v[kind_of(np.arange(len(self.v))) == kind]
        pooled = v.mean(axis=1, keepdims=True) * self.v.mean(axis=0) / self.v.mean()
        S = self.kinds[kind]
        alike = (1.0 - shrinkage) * S + shrinkage * np.eye(len(S))
        return (1.0 - pooling) * v + pooling * pooled, alike


def _correlation(S: Float[np.ndarray, "d d"]) -> Float[np.ndarray, "d d"]:
    size = np.sqrt(np.diag(S) + LEAST * np.mean(np.diag(S)))
    out = S / (size[:, None] * size)
    np.fill_diagonal(out, 1.0)
    return out


def _energies(
    r: Float[np.ndarray, "c t d"],
    power: Float[np.ndarray, "k d"],
    alike: Float[np.ndarray, "d d"],
    turns: Int[np.ndarray, " t"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of waves left out: their energy (C, K), how many numbers that is (K,), and log volumes."""
    L = np.linalg.cholesky(alike)
    half = (r / np.sqrt(power[turns])) @ np.linalg.inv(L).T
    energy = np.zeros((len(r), len(power)))
    np.add.at(energy.T, turns, np.sum(half**2, axis=2).T)
    count = np.bincount(turns)
    logdet = np.log(power).sum(axis=1) + 2.0 * np.sum(np.log(np.diag(L)))
    return energy, count * r.shape[2], logdet * count


def _square_off(
    r: Float[np.ndarray, "c t d"],
    power: Float[np.ndarray, "k d"],
    alike: Float[np.ndarray, "d d"],
    turns: Int[np.ndarray, " t"],
    missing: Sequence[int],
) -> float:
    """Square of what missing features of waves left out differ by from their mean given others."""
    hidden = list(missing)
    seen = np.setdiff1d(np.arange(r.shape[2]), hidden)
    gain = np.linalg.solve(alike[np.ix_(seen, seen)], alike[np.ix_(seen, hidden)])
    root = np.sqrt(power[turns])
    off = r[..., hidden] - ((r / root)[..., seen] @ gain) * root[:, hidden]
    return float(np.sum(off**2))


def _likelihood(
    energy: np.ndarray, numbers: np.ndarray, logdet: np.ndarray, spread: float
) -> float:
    """Log density of waves left out up to a constant, over their scales."""
    weights = log_weights(np.full(len(numbers), spread))
    scale = LOG_SCALES[:, None, None]
    each = -0.5 * energy * np.exp(-2.0 * scale) - scale * numbers + weights[:, None, :]
    over = np.asarray(logsumexp(each, axis=0))
    return float(np.sum(over) - 0.5 * len(energy) * np.sum(logdet))
