"""Voice puppetry: sound drives a face through a chain of facial states (Brand 1999).

A hidden Markov model of the face is learned with the entropic prior (`entropic_hmm`); its
emissions are the face's position and velocity. The states' probabilities in training give
every state a normal of sound as well: the chain is the face's, the sound only listens in.

From new sound y come the probabilities p(s_t | y) of the states, and from these the most
probable trajectory z, with o_t = (z_t, z_t - z_{t-1}) and every state's normal of o:

    z = argmin sum_t sum_s p(s_t = s | y) (o_t - mu_s)^T Sigma_s^-1 (o_t - mu_s)

which is linear: a band of blocks. Faces are principal components of 95 % of the variance;
sounds are cepstra and their slopes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import solveh_banded

from ..errors import InputError
from .entropic_hmm import HMM, emissions_of, learn, log_emissions, posterior_states

KEPT = 0.95


@dataclass(frozen=True)
class VoicePuppet:
    """A trained chain.

    hmm
        Of the face's position and velocity.
    sound_mean, sound_covariance
        (K, A) and (K, A, A), each state's normal of sound.
    middle, basis
        (D,) and (D, P): faces are middle + basis z.
    sound_middle, sound_spread
        (A,) of the sound features.
    """

    hmm: HMM
    sound_mean: Float[np.ndarray, "k a"]
    sound_covariance: Float[np.ndarray, "k a a"]
    middle: Float[np.ndarray, " d"]
    basis: Float[np.ndarray, "d p"]
    sound_middle: Float[np.ndarray, " a"]
    sound_spread: Float[np.ndarray, " a"]

    def states(self, sound: Float[np.ndarray, "t a"]) -> Float[np.ndarray, "t k"]:
        """Give the states' probabilities of new sound features (T, A)."""
        scaled = (sound - self.sound_middle) / self.sound_spread
        emission = log_emissions(self.sound_mean, self.sound_covariance, scaled)
        return posterior_states(self.hmm.initial, self.hmm.transition, emission)[0]

    def speak(self, sound: Float[np.ndarray, "t a"]) -> Float[np.ndarray, "t d"]:
        """Make the face of new sound."""
        return self.middle + trajectory(self.hmm, self.states(sound)) @ self.basis.T


def train_puppet(
    sound: Sequence[Float[np.ndarray, "_ a"]],
    face: Sequence[Float[np.ndarray, "_ d"]],
    *,
    states: int,
    seed: int,
    steps: int = 40,
) -> VoicePuppet:
    """Train voice puppetry on clips.

    Parameters
    ----------
    sound, face
        Features of every clip, as many frames of each.
    states
        K.
    seed
        Of the clusters that learning begins with.
    steps
        At most so many of expectation and maximisation.

    Raises
    ------
    InputError
        If the clips of the two differ in their frames, or there are fewer than states.
    """
    if [len(s) for s in sound] != [len(f) for f in face]:
        raise InputError("voice puppetry", "sound and face differ in frames", "Align them")
    every, heard = np.concatenate(face), np.concatenate(sound)
    if not 0 < states <= len(every):
        raise InputError("states", f"there are {states} for {len(every)} frames", "Use fewer")
    middle, basis = _components(every)
    z = [(clip - middle) @ basis for clip in face]
    moving = [np.concatenate([clip, velocity(clip)], axis=1) for clip in z]
    learned = learn(moving, states, seed=seed, steps=steps)
    sound_middle, spread = heard.mean(axis=0), heard.std(axis=0)
    listens = emissions_of((heard - sound_middle) / spread, learned.occupancy)
    return VoicePuppet(learned.hmm, *listens, middle, basis, sound_middle, spread)


def velocity(z: Float[np.ndarray, "t p"]) -> Float[np.ndarray, "t p"]:
    """Give z_t - z_{t-1}; the first frame has that of the second."""
    steps = np.diff(z, axis=0)
    return np.concatenate([steps[:1], steps])


def trajectory(hmm: HMM, occupancy: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t p"]:
    """Give the most probable positions under the states' normals of position and velocity.

    The first frame's velocity counts for nothing.
    """
    p = hmm.mean.shape[1] // 2
    precision = np.linalg.inv(hmm.covariance)
    wanted = np.einsum("kij,kj->ki", precision, hmm.mean)
    weight = np.einsum("tk,kij->tij", occupancy, precision)
    target = occupancy @ wanted
    own, both, fast = weight[:, :p, :p], weight[:, :p, p:], weight[:, p:, p:]
    # The first frame has no velocity.
    both[0], fast[0], target[0, p:] = 0.0, 0.0, 0.0
    diagonal = own + both + both.transpose(0, 2, 1) + fast
    diagonal[:-1] += fast[1:]
    beside = -(both + fast)[1:]  # rows of frame t, columns of frame t - 1
    right = target[:, :p] + target[:, p:]
    right[:-1] -= target[1:, p:]
    return _solve_band(diagonal, beside, right)


def _solve_band(
    diagonal: Float[np.ndarray, "t p p"],
    beside: Float[np.ndarray, "t1 p p"],
    right: Float[np.ndarray, "t p"],
) -> Float[np.ndarray, "t p"]:
    """Solve the symmetric block tridiagonal system."""
    t, p = right.shape
    band = np.zeros((2 * p, t * p))  # lower form: band[i - j, j] = a[i, j]
    for i in range(p):
        for j in range(p):
            if i >= j:
                band[i - j, j::p] = diagonal[:, i, j]
            band[p + i - j, j : (t - 1) * p : p] = beside[:, i, j]
    return solveh_banded(band, right.ravel(), lower=True).reshape(t, p)


def _components(every: Float[np.ndarray, "n d"]) -> tuple[np.ndarray, np.ndarray]:
    """Give the mean, and principal components of `KEPT` of the variance."""
    middle = every.mean(axis=0)
    _, size, directions = np.linalg.svd(every - middle, full_matrices=False)
    share = np.cumsum(size**2) / np.sum(size**2)
    return middle, directions[: int(np.searchsorted(share, KEPT)) + 1].T
