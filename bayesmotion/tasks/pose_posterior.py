"""The poses of a cycle given its latent path and what was measured: the rest of eq. 15.

    u_td = y_td + noise_td,   y_t = f(x_t) + d_t

With the path x known f has its mean there, and what is left to say is the subject residual
d (T, D). Cycles close, so its harmonics, how much of d goes round k times in a cycle, are
independent of each other. Cosine and sine of harmonic k are multivariate normal over the
features with a scale that is each person's own:

    d = sum_j h_j d_j,      d_j ~ N(0, scale_k^2 (P_k^1/2 A P_k^1/2 + excess I))
    log scale_k ~ N(0, log_scale_sd^2)

P_k is diagonal, the power of each feature; A, the correlations of features, is one of a
band of harmonics (`BANDS`): of how a person stands (k = 0), of the swing of a whole stride
(k = 1), under which what a left limb does the right one does half a cycle later the other
way, of that of a step (k = 2), and of all that is faster. Each band has its own sd of
scales. The excess is the process's variance above what it had for people left out. Scales
are integrated over a grid, for each k by itself: somebody who swings one arm as nobody in
training is unlikely to swing the other as usual.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import logsumexp

from ..gp.linalg import AnyArray
from ..models.gait_pose.harmonics import harmonics_of
from .latent import LatentPath, Measured

# Variance that what is exact has all the same, so that no covariance is singular.
TINY = 1e-8
# Scales are tried from a quarter to eight times the usual; one is among them.
LOG_SCALES = np.log(2.0) * np.arange(-8, 13) / 4.0
BANDS = ("standing", "stride", "step", "faster")
LOG_2PI = float(np.log(2.0 * np.pi))


def band_of(number: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Return which of `BANDS` harmonics belong to that go round so many times in a cycle."""
    return np.minimum(number, len(BANDS) - 1)


class SubjectResidual(NamedTuple):
    """How a new person's cycles differ from what the process makes of them; see the module.

    power
        (K, D) variance of harmonic k of every feature.
    correlation
        (4, D, D) of features, in every band of harmonics.
    log_scale_sd
        (4,) standard deviation of the logarithm of a scale, in every band.
    process_variance
        Mean variance the process had for people left out, which is counted in already.
    """

    power: Float[AnyArray, "k d"]
    correlation: Float[AnyArray, "4 d d"]
    log_scale_sd: Float[AnyArray, " 4"]
    process_variance: Float[AnyArray, ""]

    def white(self, poses: int) -> Float[np.ndarray, " d"]:
        """Return the mean variance of each feature over a cycle of so many poses."""
        number, _ = harmonics_of(poses)
        return np.asarray(self.power)[number].mean(axis=0)

    def sd_of_harmonics(self) -> Float[np.ndarray, " k"]:
        """Return the standard deviation of the log scale of harmonic k."""
        return np.asarray(self.log_scale_sd)[band_of(np.arange(len(self.power)))]

    def covariances(self, excess: float = 0.0) -> Float[np.ndarray, "k d d"]:
        """Return the covariance (K, D, D) between features of harmonic k, at scale one."""
        root = np.sqrt(np.asarray(self.power))
        S = np.asarray(self.correlation)[band_of(np.arange(len(root)))]
        S = root[:, :, None] * root[:, None, :] * S
        return S + excess * np.eye(S.shape[1])


def log_weights(log_scale_sd: Float[AnyArray, " k"]) -> Float[np.ndarray, "g k"]:
    """Return log prior probabilities of `LOG_SCALES`; of one alone where the sd is zero."""
    off = LOG_SCALES[:, None] / np.maximum(np.asarray(log_scale_sd), 1e-3)
    return -0.5 * off**2 - logsumexp(-0.5 * off**2, axis=0)


def white_residual(variance: Sequence[float] | np.ndarray, poses: int) -> SubjectResidual:
    """Return a residual that neither time nor features share: eq. 15 as in the paper."""
    variance = np.asarray(variance, float)
    power = np.tile(variance, (poses // 2 + 1, 1))
    correlation = np.tile(np.eye(len(variance)), (len(BANDS), 1, 1))
    return SubjectResidual(power, correlation, np.zeros(len(BANDS)), np.zeros(()))


@dataclass(frozen=True)
class Pose:
    """A distribution of the poses of a cycle, for one draw of the trained model.

    mean, sd
        (T, D) of every feature.
    log_density
        Log density of what was measured, at the latent path found.
    """

    mean: Float[np.ndarray, "t d"]
    sd: Float[np.ndarray, "t d"]
    log_density: float


def pose_given(
    path: LatentPath, given: Measured, residual: SubjectResidual, level: float = 1.0
) -> Pose:
    """Return the poses of a cycle, given the latent path and what was measured.

    Where features are seen in some poses only, or not equally well in all, harmonics cannot
    be told apart, and scales are what they are in the mean.

    Parameters
    ----------
    path
        The latent path, and what the process says there.
    given
        What is measured.
    residual
        What is the person's own.
    level
        What the standard deviation of all noise is multiplied by.
    """
    off, seen, noise, excess = _seen_of(path, given, residual)
    if _alike(seen, noise):
        pose = _by_harmonics(off, seen, noise, residual, excess).given(level**2)
    else:
        pose = _by_entries(off, seen, level**2 * noise, residual, excess)
    return replace(pose, mean=path.mean + pose.mean)


def level_log_densities(
    path: LatentPath, given: Measured, residual: SubjectResidual, levels: Sequence[float]
) -> Float[np.ndarray, " l"]:
    """Return the log density of what was measured, with all noise so many times as large.

    Parameters
    ----------
    levels
        What the standard deviation of all noise is multiplied by, one after another.
    """
    off, seen, noise, excess = _seen_of(path, given, residual)
    if _alike(seen, noise):
        harmonics = _by_harmonics(off, seen, noise, residual, excess)
        return np.array([harmonics.log_density(level**2) for level in levels])
    poses = [_by_entries(off, seen, level**2 * noise, residual, excess) for level in levels]
    return np.array([pose.log_density for pose in poses])


def _seen_of(
    path: LatentPath, given: Measured, residual: SubjectResidual
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return what is measured less the process, where, its noise, and the process's excess."""
    seen, noise = np.asarray(given.seen) > 0, np.asarray(given.noise) + TINY
    above = np.maximum(path.variance - float(residual.process_variance), 0.0)
    return np.asarray(given.u) - path.mean, seen, noise, float(np.mean(above))


def _alike(seen: np.ndarray, noise: np.ndarray) -> bool:
    """Whether every pose is seen alike."""
    return bool((seen == seen[:1]).all() and (noise == noise[:1]).all())


@dataclass(frozen=True)
class _Harmonics:
    """What is measured, by harmonics, in directions where noise and residual are diagonal.

    waves, number
        As `harmonics_of` returns them.
    size
        (K, S) the residual's variance in units of the noise's.
    measured
        (T, S) of every harmonic.
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
    number: Int[np.ndarray, " t"]
    size: Float[np.ndarray, "k s"]
    measured: Float[np.ndarray, "t s"]
    shared: Float[np.ndarray, "k s d"]
    own: Float[np.ndarray, "k d"]
    constant: float
    weights: Float[np.ndarray, "g k"]

    def _log_each(self, noise: float) -> tuple[np.ndarray, np.ndarray]:
        """Log density (G, K) of every scale, and what is measured's variance (G, K, S)."""
        total = np.exp(2.0 * LOG_SCALES)[:, None, None] * self.size + noise
        energy = np.zeros_like(self.size)
        np.add.at(energy, self.number, self.measured**2)
        count = np.bincount(self.number)[:, None]
        each = -0.5 * np.sum(energy / total + count * np.log(total), axis=2)
        return each + self.weights, total

    def log_density(self, noise: float) -> float:
        """Log density of what is measured, with `noise` times the variance."""
        each, _ = self._log_each(noise)
        constant = self.constant - 0.5 * self.measured.size * LOG_2PI
        return float(np.sum(np.asarray(logsumexp(each, axis=0))) + constant)

    def given(self, noise: float) -> Pose:
        """Condition, with `noise` times the variance, on every scale; and average."""
        each, total = self._log_each(noise)
        square = np.exp(2.0 * LOG_SCALES)[:, None, None]
        weight = np.exp(each - logsumexp(each, axis=0))
        gain = square / total
        mean_gain = np.sum(weight[:, :, None] * gain, axis=0)  # (K, S)
        drawn = self.measured * mean_gain[self.number]
        shift = np.einsum("ts,tsd->td", drawn, self.shared[self.number])
        # Variance within a scale, and of the means between scales.
        explained = np.sum(weight[:, :, None] * square * gain, axis=0)
        variance = np.sum(weight * square[:, :, 0], axis=0)[:, None] * self.own
        variance = variance - np.einsum("ks,ksd->kd", explained, self.shared**2)
        every = variance[self.number] + self._between(weight, gain, mean_gain)
        sd = np.sqrt(np.maximum(self.waves.T**2 @ every, 0.0))
        return Pose(self.waves.T @ shift, sd, self.log_density(noise))

    def _between(self, weight, gain, mean_gain) -> Float[np.ndarray, "t d"]:
        """Variance of a harmonic's mean between scales."""
        off = (gain - mean_gain) * np.sqrt(weight)[:, :, None]  # (G, K, S)
        out = np.zeros((len(self.number), self.own.shape[1]))
        for wave, k in enumerate(self.number):
            out[wave] = np.sum(((off[:, k] * self.measured[wave]) @ self.shared[k]) ** 2, axis=0)
        return out


def _by_harmonics(
    off: Float[np.ndarray, "t d"],
    seen: Bool[np.ndarray, "t d"],
    noise: Float[np.ndarray, "t d"],
    residual: SubjectResidual,
    excess: float,
) -> _Harmonics:
    """Return what is measured in directions where the covariance of every harmonic is diagonal.

    It is scale^2 S + W, W the noise; the eigenvectors of W^-1/2 S W^-1/2 serve all scales, and
    all levels of the noise.
    """
    columns = np.flatnonzero(seen[0])
    number, waves = harmonics_of(len(off))
    S = residual.covariances(excess)
    root = np.sqrt(noise[0, columns])
    own = S[:, columns][:, :, columns] / (root[:, None] * root)
    size, Q = np.linalg.eigh(own)
    back = Q / root[:, None]
    return _Harmonics(
        waves,
        number,
        np.maximum(size, 0.0),
        np.einsum("ts,tsq->tq", waves @ off[:, columns], back[number]),
        np.einsum("ksq,ksd->kqd", back, S[:, columns]),
        np.diagonal(S, axis1=1, axis2=2),
        -0.5 * len(off) * float(np.sum(np.log(noise[0, columns]))),
        log_weights(residual.sd_of_harmonics()),
    )


def _by_entries(
    off: Float[np.ndarray, "t d"],
    seen: Bool[np.ndarray, "t d"],
    noise: Float[np.ndarray, "t d"],
    residual: SubjectResidual,
    excess: float,
) -> Pose:
    """Condition on whatever entries are seen, by one large covariance."""
    number, waves = harmonics_of(len(off))
    square = np.exp(2.0 * LOG_SCALES) @ np.exp(log_weights(residual.sd_of_harmonics()))
    S = (square[:, None, None] * residual.covariances(excess))[number]
    own = np.einsum("jt,jab,js->tasb", waves, S, waves, optimize=True)
    own = own.reshape(seen.size, seen.size)
    known = np.flatnonzero(seen)
    K = own[np.ix_(known, known)] + np.diag(noise.ravel()[known])
    L = np.linalg.cholesky(K)
    half = np.linalg.solve(L, off.ravel()[known])
    gain = np.linalg.solve(L, own[known])
    variance = np.diag(own) - np.sum(gain**2, axis=0)
    constant = len(known) * LOG_2PI + 2.0 * np.sum(np.log(np.diag(L)))
    sd = np.sqrt(np.maximum(variance, 0.0)).reshape(seen.shape)
    shift = (gain.T @ half).reshape(seen.shape)
    return Pose(shift, sd, float(-0.5 * (half @ half + constant)))
