"""How new people differ from what a gait-pose model makes of them, learned by leaving out.

A process that was fitted to people goes through their poses; how far it will be from a
new person's is seen by taking one person's cycles out of what it is conditioned on,
and finding latent paths for them as for a new person (`leave_people_out`). Of what is
left over, cycle by cycle, a matrix-normal distribution is made (`learn_deviation`):

    r (T, D) ~ N(0, time x features)
    time     = share + (1 - share) exp(-2 sin^2(pi (t - t') / T) / length^2) + nugget
    features = (1 - shrinkage) S + shrinkage diag(S) + least,   S their mean square

with share, length and shrinkage those under which the people left out are likeliest,
S being that of the others. How a person stands all through the cycle is the share.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from ..gp.linalg import AnyArray
from ..models.gait_cycles import GaitTraining
from ..models.gait_pose import GaitPose
from .latent import candidates_of, measured, represent
from .pose_posterior import Deviation

FIRST_GUESS = 0.1  # of a mean square of one: the variance paths are found with at first
NUGGET, LEAST = 1e-4, 1e-3
SHARES = (0.2, 0.4, 0.6, 0.8, 0.9)
LENGTHS = (0.25, 0.35, 0.5, 0.7, 1.0)
SHRINKAGES = (0.05, 0.1, 0.2, 0.4, 0.7)


@dataclass(frozen=True)
class LeftOver:
    """What is left over of people who were left out.

    residual
        (C, T, D) features less the process's mean.
    variance
        Mean variance the process had there.
    subjects
        (C,) the person of each cycle.
    rows
        (C, T) rows of the training data that the cycles are.
    """

    residual: Float[np.ndarray, "c t d"]
    variance: float
    subjects: tuple[str, ...]
    rows: np.ndarray


def leave_people_out(
    model: GaitPose,
    training: GaitTraining,
    values: Mapping[str, AnyArray],
    white: float = FIRST_GUESS,
) -> LeftOver:
    """Represent every person's training cycles without that person.

    Parameters
    ----------
    model, training, values
        A trained model, its data and its sites. Latent points and hyperparameters stay as
        they are; what the process is conditioned on changes.
    white
        Variance that paths are found with.
    """
    frames, poses = training.frames, training.poses
    people = np.tile(np.asarray(training.subjects), len(training.scales))
    y = np.asarray(frames.y).reshape(len(people), poses, -1)
    d = y.shape[2]
    residual, variances = np.empty_like(y), []
    for person in dict.fromkeys(people.tolist()):
        others = np.flatnonzero(people != person)
        process = model.given_some(frames, values, others)
        known = candidates_of(process)
        for cycle in np.flatnonzero(people == person):
            given = measured(y[cycle])
            found = represent(process, given, np.full(d, white), candidates=known)
            residual[cycle] = y[cycle] - found.mean
            variances.append(found.variance)
    rows = np.arange(len(y) * poses).reshape(len(y), poses)
    return LeftOver(residual, float(np.mean(variances)), tuple(people.tolist()), rows)


def learn_deviation(left: LeftOver) -> Deviation:
    """Give the distribution of what was left over."""
    r, people = left.residual, np.asarray(left.subjects)
    folds = [(r[people == one], _square(r[people != one])) for one in dict.fromkeys(people)]
    best = max(
        product(SHARES, LENGTHS, SHRINKAGES),
        key=lambda chosen: sum(_likelihood(out, S, *chosen) for out, S in folds),
    )
    share, length, shrinkage = best
    features = _shrunk(_square(r), shrinkage)
    return Deviation(features, _time(r.shape[1], share, length), np.asarray(left.variance))


def _square(r: Float[np.ndarray, "c t d"]) -> Float[np.ndarray, "d d"]:
    flat = r.reshape(-1, r.shape[2])
    return flat.T @ flat / len(flat)


def _shrunk(S: Float[np.ndarray, "d d"], shrinkage: float) -> Float[np.ndarray, "d d"]:
    own = np.diag(S)
    # Angles that hardly move in training may move a little in somebody new.
    least = LEAST * own.mean() * np.eye(len(S))
    return (1.0 - shrinkage) * S + shrinkage * np.diag(own) + least


def _time(poses: int, share: float, length: float) -> Float[np.ndarray, "t t"]:
    at = np.pi * np.arange(poses) / poses
    wave = np.exp(-2.0 * np.sin(at[:, None] - at[None, :]) ** 2 / length**2)
    return (share + (1.0 - share) * wave + NUGGET * np.eye(poses)) / (1.0 + NUGGET)


def _likelihood(r: Float[np.ndarray, "c t d"], S, share, length, shrinkage) -> float:
    """Log density of cycles left over, up to a constant."""
    time, features = _time(r.shape[1], share, length), _shrunk(S, shrinkage)
    half = np.linalg.solve(np.linalg.cholesky(time), r)
    half = np.linalg.solve(np.linalg.cholesky(features), half.swapaxes(1, 2))
    logdet = r.shape[2] * np.linalg.slogdet(time)[1] + r.shape[1] * np.linalg.slogdet(features)[1]
    return float(-0.5 * np.sum(half**2) - 0.5 * len(r) * logdet)
