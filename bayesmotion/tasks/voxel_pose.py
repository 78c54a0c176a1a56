"""Poses from voxels: train the mixture and the regression, and recognise.

    voxels -> shape contexts -> mixture of PPCA -> features -> relevance vectors -> pose

`voxel_files` saves and loads what was trained.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..models.clusters import squared_distances
from ..models.joint_angles import PoseSpace, learn_space
from ..models.mixture_em import Mixture, fit_mixture
from ..models.relevance_fast import Relevant, maximise_marginal
from ..models.relevance_vector import basis_functions
from ..motion import Skeleton
from ..sensing.shape_context import ShapeContext
from .voxel_features import Descriptors, features

# Half the width of a 90 % interval in standard deviations.
NINETY = 1.6448536269514722
# Length scales tried, in medians of the distances between training features.
SCALES = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4)
# Training frames, at most about twice as many, that the length scale is chosen with.
SCALED_BY = 300
Say = Callable[[str], None]


@dataclass(frozen=True)
class Settings:
    """How poses are learned from voxels.

    context
        Bins of the descriptors.
    cell
        Side in voxels of the cubes basis voxels are chosen from.
    components, latent
        K and Q of the mixture.
    share
        Of the poses' variance that is regressed.
    points
        At most so many descriptors train the mixture.
    mixture_steps, steps
        At most so many of EM, and of the relevance vectors' search.
    tolerance
        Gain of log marginal likelihood below which that search takes no step.
    length_scale
        Of the kernel, in medians of the distances between training features; None for
        the likeliest of `SCALES`.
    """

    context: ShapeContext = field(default_factory=ShapeContext)
    cell: int = 3
    components: int = 200
    latent: int = 5
    share: float = 0.9
    points: int = 200_000
    mixture_steps: int = 25
    steps: int = 4000
    tolerance: float = 0.1
    length_scale: float | None = None


@dataclass(frozen=True)
class Regressor:
    """Relevance vectors from features to poses.

    space
        The poses' principal components.
    vectors
        (A, F) features of the training frames kept; NaN in the row of the constant.
    length_scale
        Of the kernel.
    relevant
        The regression.
    of
        How many training frames there were.
    """

    space: PoseSpace
    vectors: Float[np.ndarray, "a f"]
    length_scale: float
    relevant: Relevant
    of: int

    def phi(self, x: Float[np.ndarray, "n f"]) -> Float[np.ndarray, "n a"]:
        """Give the kept basis functions at features x."""
        constant = np.isnan(self.vectors[:, 0])
        full = basis_functions(x, self.vectors[~constant], self.length_scale)
        out = np.ones((len(x), len(self.vectors)))
        out[:, ~constant] = full[:, 1:]
        return out

    def __call__(
        self, x: Float[np.ndarray, "n f"]
    ) -> tuple[Float[np.ndarray, "n a2"], Float[np.ndarray, "n a2"]]:
        """Give the angles of poses, and their standard deviations, in radians."""
        z, variance = self.relevant.predict(self.phi(x))
        return self.space.decode(z), self.space.spread(z, variance)


@dataclass(frozen=True)
class VoxelPose:
    """A trained way from voxels to poses.

    settings
        How it was trained.
    mixture
        Of the descriptors.
    regressor
        From features to poses.
    skeleton, rest
        What a recognised pose is put on, and the mean angle in radians of the degrees of
        freedom that are not recognised.
    seed, seconds
        Of the training.
    """

    settings: Settings
    mixture: Mixture
    regressor: Regressor
    skeleton: Skeleton
    rest: Mapping[str, float]
    seed: int
    seconds: float

    def recognise(
        self, descriptors: Descriptors
    ) -> tuple[Float[np.ndarray, "f a"], Float[np.ndarray, "f a"]]:
        """Give the angles of every frame and their standard deviations, in radians."""
        return self.regressor(features(descriptors, self.mixture))


def median_distance(x: Float[np.ndarray, "n f"]) -> float:
    """Give the median distance between points (of many, between some of them)."""
    some = x[:: max(1, len(x) // 1000)]
    squared = squared_distances(some, some)[np.triu_indices(len(some), 1)]
    return float(np.sqrt(np.median(squared)))


def train_regressor(
    x: Float[np.ndarray, "n f"],
    angles: Float[np.ndarray, "n a"],
    labels: Sequence[str],
    settings: Settings,
    say: Say | None = None,
) -> Regressor:
    """Find the relevance vectors from features to poses.

    The kernel's length is that whose log marginal likelihood of some of the frames is the
    largest, unless the settings give it.
    """
    space = learn_space(angles, labels, settings.share)
    z = space.encode(angles)
    scale = settings.length_scale or _likeliest_scale(x, z, settings, say)
    length = scale * median_distance(x)
    relevant = _search(basis_functions(x, x, length), z, settings)
    if say is not None:
        end = "converged" if relevant.converged else "not converged"
        say(
            f"length {scale:g}: log marginal likelihood {relevant.log_marginal:.0f}, "
            f"{len(relevant.kept)} of {len(x)} kept, {end} after {relevant.steps} steps"
        )
    vectors = np.full((len(relevant.kept), x.shape[1]), np.nan)
    some = relevant.kept > 0
    vectors[some] = x[relevant.kept[some] - 1]
    return Regressor(space, vectors, length, relevant, len(x))


def _search(phi: np.ndarray, z: np.ndarray, settings: Settings) -> Relevant:
    return maximise_marginal(phi, z, max_steps=settings.steps, tolerance=settings.tolerance)


def _likeliest_scale(x: np.ndarray, z: np.ndarray, settings: Settings, say: Say | None) -> float:
    """Find which of `SCALES` makes some of the frames likeliest."""
    some = slice(None, None, max(1, len(x) // SCALED_BY))
    x, z = x[some], z[some]
    unit = median_distance(x)
    found: dict[float, float] = {}
    for scale in SCALES:
        phi = basis_functions(x, x, scale * unit)
        found[scale] = _search(phi, z, settings).log_marginal
        if say is not None:
            say(f"length {scale:g}, {len(x)} frames: log marginal likelihood {found[scale]:.0f}")
    return max(found, key=lambda scale: found[scale])


def train_mixture(
    descriptors: Descriptors,
    settings: Settings,
    *,
    seed: int,
    say: Say | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Mixture:
    """Train the mixture alone; arguments as for `train`."""
    began = time.perf_counter()
    points = descriptors.sample(settings.points, seed)
    estimate = fit_mixture(
        points,
        settings.components,
        settings.latent,
        seed=seed,
        max_steps=settings.mixture_steps,
        progress=progress,
    )
    if say is not None:
        end = "converged" if estimate.converged else "not converged"
        say(
            f"mixture of {len(points)} descriptors: log likelihood "
            f"{estimate.log_likelihood[-1] / len(points):.2f} a point, {end} after "
            f"{len(estimate.log_likelihood) - 1} steps, {time.perf_counter() - began:.0f} s"
        )
    return estimate.mixture


def train(
    descriptors: Descriptors,
    angles: Float[np.ndarray, "f a"],
    labels: Sequence[str],
    settings: Settings,
    *,
    seed: int,
    skeleton: Skeleton,
    rest: Mapping[str, float],
    mixture: Mixture | None = None,
    say: Say | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> VoxelPose:
    """Train the mixture on descriptors, and the regression on frames.

    Parameters
    ----------
    descriptors
        Of all training frames.
    angles, labels
        Poses of these frames, as `joint_angles.angles_of` gives them.
    settings
        How.
    seed
        Of which descriptors train the mixture, and of its start.
    skeleton, rest
        For writing motions: a skeleton with these angles, and the angles of its other
        degrees of freedom.
    mixture
        Of the descriptors, if it is trained already.
    say
        Called with a line after every stage.
    progress
        Called with the mixture's steps and its log likelihood a point.

    Raises
    ------
    InputError
        If there are not as many poses as frames, or the data say nothing.
    """
    if len(angles) != len(descriptors.counts):
        raise InputError(
            "training", f"{len(angles)} poses for {len(descriptors.counts)} frames", "Give as many"
        )
    began = time.perf_counter()
    mixture = mixture or train_mixture(descriptors, settings, seed=seed, say=say, progress=progress)
    x = features(descriptors, mixture)
    regressor = train_regressor(x, angles, labels, settings, say)
    seconds = time.perf_counter() - began
    return VoxelPose(settings, mixture, regressor, skeleton, dict(rest), seed, seconds)
