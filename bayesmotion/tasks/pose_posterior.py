"""The poses of a cycle given its latent path and what was measured: the rest of eq. 15.

    u_td = y_td + noise_td,   y_t = f(x_t) + d_t

With the path x known f has its mean there, and what is left to say is the person's own
deviation d (T, D). Cycles close, so its waves, how much of d turns k times in a cycle, are
independent of each other. Both waves of k, the cosine and the sine, are multivariate normal
over the features with a scale that is each person's own:

    d = sum_j wave_j d_j,      d_j ~ N(0, scale_k^2 (P_k^1/2 A P_k^1/2 + excess I))
    log scale_k ~ N(0, spread^2)

P_k is diagonal, the power of each feature; A says how features go together, and is one of
`KINDS`: for how a person stands (k = 0), for the swing of a whole stride (k = 1), under which
what a left limb does the right one does half a cycle later the other way, for that of a step
(k = 2), and for all that is faster. Each kind has its own spread. The excess is the process's
variance above the usual. Scales are integrated over a grid, for each k by itself: somebody
who swings one arm as nobody in training is unlikely to swing the other as usual.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import logsumexp

from ..gp.linalg import AnyArray
from .latent import Measured, Represented

# Variance that what is exact has all the same, so that no covariance is singular.
TINY = 1e-8
# Scales are tried from a quarter to eight times the usual; one is among them.
LOG_SCALES = np.log(2.0) * np.arange(-8, 13) / 4.0
KINDS = ("standing", "stride", "step", "faster")
LOG_2PI = float(np.log(2.0 * np.pi))


def waves_of(poses: int) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t t"]]:
    """How often each wave of a cycle turns (T,), and the waves, orthonormal, one a row (T, T)."""
    number, at = np.arange(poses), np.arange(poses)
    turns = (number + 1) // 2
    angle = 2.0 * np.pi * turns[:, None] * at / poses
    waves = np.where((number % 2 == 1)[:, None], np.cos(angle), np.sin(angle))
    waves[0] = 1.0
    return turns, waves / np.linalg.norm(waves, axis=1, keepdims=True)


def kind_of(turns: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Which of `KINDS` waves are that turn so many times in a cycle."""
    return np.minimum(turns, len(KINDS) - 1)


class Deviation(NamedTuple):
    """How a new person's cycles differ from what the process makes of them; see the module.

    power
        (K, D) variance of a wave that turns k times, of every feature.
    alike
        (4, D, D) correlation of features, of every kind of waves.
    spread
        (4,) standard deviation of the logarithm of a scale, of every kind.
    usual
        Variance of the process that is counted in already.
    """

    power: Float[AnyArray, "k d"]
    alike: Float[AnyArray, "4 d d"]
    spread: Float[AnyArray, " 4"]
    usual: Float[AnyArray, ""]

    def white(self, poses: int) -> Float[np.ndarray, " d"]:
        """Mean variance of each feature over a cycle of so many poses."""
        turns, _ = waves_of(poses)
        return np.asarray(self.power)[turns].mean(axis=0)

    def spread_of_turns(self) -> Float[np.ndarray, " k"]:
        """Spread of the scale of waves that turn k times."""
        return np.asarray(self.spread)[kind_of(np.arange(len(self.power)))]

    def covariances(self, excess: float = 0.0) -> Float[np.ndarray, "k d d"]:
        """Covariance (K, D, D) between features of waves that turn k times, at scale one."""
        root = np.sqrt(np.asarray(self.power))
        S = np.asarray(self.alike)[kind_of(np.arange(len(root)))]
        S = root[:, :, None] * root[:, None, :] * S
        return S + excess * np.eye(S.shape[1])


def log_weights(spread: Float[AnyArray, " k"]) -> Float[np.ndarray, "g k"]:
    """Log prior probability of every one of `LOG_SCALES`; of one alone where `spread` is zero."""
    off = LOG_SCALES[:, None] / np.maximum(np.asarray(spread), 1e-3)
    return -0.5 * off**2 - logsumexp(-0.5 * off**2, axis=0)


def white_deviation(variance: Sequence[float] | np.ndarray, poses: int) -> Deviation:
    """Give a deviation that neither time nor features share: eq. 15 as in the paper."""
    variance = np.asarray(variance, float)
    power = np.tile(variance, (poses // 2 + 1, 1))
    alike = np.tile(np.eye(len(variance)), (len(KINDS), 1, 1))
    return Deviation(power, alike, np.zeros(len(KINDS)), np.zeros(()))


@dataclass(frozen=True)
class Pose:
    """A distribution of the poses of a cycle.

    mean, sd
        (T, D) of every feature.
    log_density
        Log density of what was measured, at the latent path found.
    """

    mean: Float[np.ndarray, "t d"]
    sd: Float[np.ndarray, "t d"]
    log_density: float


def pose_given(found: Represented, given: Measured, deviation: Deviation) -> Pose:
    """Give the poses of a cycle, given the latent path and what was measured.

    Where features are seen in some poses only, or not equally well in all, waves cannot be
    told apart, and scales are what they are in the mean.

    Parameters
    ----------
    found
        The latent path, and what the process says there.
    given
        What is measured.
    deviation
        What is the person's own.
    """
    return pose_at_best_level(found, given, deviation, [1.0])[0]


def pose_at_best_level(
    found: Represented, given: Measured, deviation: Deviation, levels: Sequence[float]
) -> tuple[Pose, int]:
    """As `pose_given` with all noise so many times as large as makes what is measured likeliest.

    Parameters
    ----------
    levels
        What the standard deviation of all noise is multiplied by, one after another.

    Returns
    -------
    The poses, and which of the levels it was.
    """
    seen, noise = np.asarray(given.seen) > 0, np.asarray(given.noise) + TINY
    # The process's variance above the usual, in the mean.
    excess = float(np.mean(np.maximum(found.variance - float(deviation.usual), 0.0)))
    if (seen == seen[:1]).all() and (noise == noise[:1]).all():
        columns = np.flatnonzero(seen[0])
        residual = np.asarray(given.u)[:, columns] - found.mean[:, columns]
        waves = _turned(residual, columns, noise[0, columns], deviation, excess)
        best = int(np.argmax([waves.log_density(level**2) for level in levels]))
        pose = waves.given(levels[best] ** 2)
    else:
        residual = np.asarray(given.u) - found.mean
        poses = [
            _by_entries(residual, seen, level**2 * noise, deviation, excess) for level in levels
        ]
        best = int(np.argmax([pose.log_density for pose in poses]))
        pose = poses[best]
    return replace(pose, mean=found.mean + pose.mean), best


@dataclass(frozen=True)
class _Waves:
    """What is measured, wave by wave, in directions where noise and deviation are diagonal.

    waves, turns
        As `waves_of` gives them.
    size
        (K, S) the deviation's variance in units of the noise's.
    residual
        (T, S) of every wave.
    shared
        (K, S, D) covariance of the directions with every feature.
    own
        (K, D) variance of every feature.
    constant
        Log of the volume the directions take.
    weights
        (G, K) log prior of the scales.
    """

    waves: Float[np.ndarray, "t t"]
    turns: Int[np.ndarray, " t"]
    size: Float[np.ndarray, "k s"]
    residual: Float[np.ndarray, "t s"]
    shared: Float[np.ndarray, "k s d"]
    own: Float[np.ndarray, "k d"]
    constant: float
    weights: Float[np.ndarray, "g k"]

    def _log_each(self, noise: float) -> tuple[np.ndarray, np.ndarray]:
        """Log density (G, K) of every scale, and what is measured's variance (G, K, S)."""
        total = np.exp(2.0 * LOG_SCALES)[:, None, None] * self.size + noise
        energy = np.zeros_like(self.size)
        np.add.at(energy, self.turns, self.residual**2)
        count = np.bincount(self.turns)[:, None]
        each = -0.5 * np.sum(energy / total + count * np.log(total), axis=2)
        return each + self.weights, total

    def log_density(self, noise: float) -> float:
        """Log density of what is measured, with `noise` times the variance."""
        each, _ = self._log_each(noise)
        constant = self.constant - 0.5 * self.residual.size * LOG_2PI
        return float(np.sum(np.asarray(logsumexp(each, axis=0))) + constant)

    def given(self, noise: float) -> Pose:
        """Condition, with `noise` times the variance, on every scale; and average."""
        each, total = self._log_each(noise)
        square = np.exp(2.0 * LOG_SCALES)[:, None, None]
        weight = np.exp(each - logsumexp(each, axis=0))
        gain = square / total
        mean_gain = np.sum(weight[:, :, None] * gain, axis=0)  # (K, S)
        drawn = self.residual * mean_gain[self.turns]
        shift = np.einsum("ts,tsd->td", drawn, self.shared[self.turns])
        # Variance within a scale, and of the means between scales.
        explained = np.sum(weight[:, :, None] * square * gain, axis=0)
        variance = np.sum(weight * square[:, :, 0], axis=0)[:, None] * self.own
        variance = variance - np.einsum("ks,ksd->kd", explained, self.shared**2)
        every = variance[self.turns] + self._between(weight, gain, mean_gain)
        sd = np.sqrt(np.maximum(self.waves.T**2 @ every, 0.0))
        return Pose(self.waves.T @ shift, sd, self.log_density(noise))

    def _between(self, weight, gain, mean_gain) -> Float[np.ndarray, "t d"]:
        """Variance of a wave's mean between scales."""
        off = (gain - mean_gain) * np.sqrt(weight)[:, :, None]  # (G, K, S)
        out = np.zeros((len(self.turns), self.own.shape[1]))
        for wave, k in enumerate(self.turns):
            out[wave] = np.sum(((off[:, k] * self.residual[wave]) @ self.shared[k]) ** 2, axis=0)
        return out


def _turned(
    residual: Float[np.ndarray, "t s"],
    columns: Int[np.ndarray, " s"],
    noise: Float[np.ndarray, " s"],
    deviation: Deviation,
    excess: float,
) -> _Waves:
    """Turn what is measured so that the covariance of every wave is diagonal.

    It is scale^2 S + W, W the noise; the eigenvectors of W^-1/2 S W^-1/2 serve all scales, and
    all levels of the noise.
    """
    turns, waves = waves_of(len(residual))
    S = deviation.covariances(excess)
    root = np.sqrt(noise)
    seen = S[:, columns][:, :, columns] / (root[:, None] * root)
    size, Q = np.linalg.eigh(seen)
    back = Q / root[:, None]
    return _Waves(
        waves,
        turns,
        np.maximum(size, 0.0),
        np.einsum("ts,tsq->tq", waves @ residual, back[turns]),
        np.einsum("ksq,ksd->kqd", back, S[:, columns]),
        np.diagonal(S, axis1=1, axis2=2),
        -0.5 * len(residual) * float(np.sum(np.log(noise))),
        log_weights(deviation.spread_of_turns()),
    )


def _by_entries(
    residual: Float[np.ndarray, "t d"],
    seen: Bool[np.ndarray, "t d"],
    noise: Float[np.ndarray, "t d"],
    deviation: Deviation,
    excess: float,
) -> Pose:
    """Condition on whatever entries are seen, by one large covariance."""
    turns, waves = waves_of(len(residual))
    square = np.exp(2.0 * LOG_SCALES) @ np.exp(log_weights(deviation.spread_of_turns()))
    S = (square[:, None, None] * deviation.covariances(excess))[turns]
    own = np.einsum("jt,jab,js->tasb", waves, S, waves, optimize=True)
    own = own.reshape(seen.size, seen.size)
    known = np.flatnonzero(seen)
    K = own[np.ix_(known, known)] + np.diag(noise.ravel()[known])
    L = np.linalg.cholesky(K)
    half = np.linalg.solve(L, residual.ravel()[known])
    gain = np.linalg.solve(L, own[known])
    variance = np.diag(own) - np.sum(gain**2, axis=0)
    constant = len(known) * LOG_2PI + 2.0 * np.sum(np.log(np.diag(L)))
    sd = np.sqrt(np.maximum(variance, 0.0)).reshape(seen.shape)
    shift = (gain.T @ half).reshape(seen.shape)
    return Pose(shift, sd, float(-0.5 * (half @ half + constant)))
