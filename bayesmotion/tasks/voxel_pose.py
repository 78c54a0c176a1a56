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
from ..models.mixture_em import Mixture, fit_mixture
from ..models.pose_space import PoseSpace, learn_space
from ..models.relevance_fast import Relevant, maximise_marginal
from ..models.relevance_vector import basis_functions
from ..motion import Skeleton
from ..sensing.shape_context import ShapeContext
from .voxel_features import Descriptors, features, rooted

# Length scales tried, in medians of the distances between training features.
SCALES = (0.5, 0.7, 1.0)
# Length in frames of the stretches held out, and how many frames at most are fitted then.
STRETCH = 12
FITTED = 700
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
    least_noise
        Variance of the regression's noise, at least, as a share of an output's. The marginal
        likelihood takes the frames for independent, and likes no noise at all best.
    candidates
        At most so many training frames, evenly chosen, have basis functions to choose from.
    length_scale
        Of the kernel, in medians of the distances between training features; None for
        that of `SCALES` which does best on frames held out.
    """

    context: ShapeContext = field(default_factory=ShapeContext)
    cell: int = 3
    components: int = 200
    latent: int = 5
    share: float = 0.9
    points: int = 200_000
    mixture_steps: int = 25
    steps: int = 4000
    tolerance: float = 1.0
    least_noise: float = 0.2
    candidates: int = 2400
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
    held_out
        (P,) mean squared errors of the outputs on training frames held out.
    of
        How many training frames there were.
    """

    space: PoseSpace
    vectors: Float[np.ndarray, "a f"]
    length_scale: float
    relevant: Relevant
    held_out: Float[np.ndarray, " p"]
    of: int

    def phi(self, x: Float[np.ndarray, "n f"]) -> Float[np.ndarray, "n a"]:
        """Give the kept basis functions at features x."""
        constant = np.isnan(self.vectors[:, 0])
        full = basis_functions(x, self.vectors[~constant], self.length_scale)
        out = np.ones((len(x), len(self.vectors)))
        out[:, ~constant] = full[:, 1:]
        return out

    def outputs(
        self, x: Float[np.ndarray, "n f"]
    ) -> tuple[Float[np.ndarray, "n p"], Float[np.ndarray, "n p"]]:
        """Give z and its variances, which are not less than the errors on frames held out."""
        z, variance = self.relevant.predict(self.phi(x))
        return z, np.maximum(variance, self.held_out)

    def __call__(
        self, x: Float[np.ndarray, "n f"]
    ) -> tuple[Float[np.ndarray, "n a2"], Float[np.ndarray, "n a2"]]:
        """Give the angles of poses, and their standard deviations, in radians."""
        z, variance = self.outputs(x)
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
        return self.regressor(rooted(features(descriptors, self.mixture)))


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

    Every other stretch of the frames is held out to choose the kernel's length, unless the
    settings give it, and to learn how far off predictions are.
    """
    space = learn_space(angles, labels, settings.share)
    z = space.encode(angles)
    scales = SCALES if settings.length_scale is None else (settings.length_scale,)
    errors = {}
    for one in scales:
        errors[one] = _held_out(x, z, one, settings)
        if say is not None:
            share = float(errors[one] @ space.scale**2 / (space.scale**2).sum())
            say(f"length {one:g}: {100 * share:.1f} % of the variance missed where held out")
    scale = min(errors, key=lambda one: float(errors[one] @ space.scale**2))
    length = scale * median_distance(x)
    centres = x[:: -(-len(x) // settings.candidates)]
    relevant = _search(basis_functions(x, centres, length), z, settings)
    if say is not None:
        end = "converged" if relevant.converged else "not converged"
        say(
            f"length {scale:g}: log marginal likelihood {relevant.log_marginal:.0f}, "
            f"{len(relevant.kept)} of {len(x)} kept, {end} after {relevant.steps} steps"
        )
    vectors = np.full((len(relevant.kept), x.shape[1]), np.nan)
    some = relevant.kept > 0
    vectors[some] = centres[relevant.kept[some] - 1]
    return Regressor(space, vectors, length, relevant, errors[scale], len(x))


def _search(phi: np.ndarray, z: np.ndarray, settings: Settings) -> Relevant:
    # The outputs have unit variance, so that the share is a variance.
    return maximise_marginal(
        phi,
        z,
        least_noise=settings.least_noise,
        max_steps=settings.steps,
        tolerance=settings.tolerance,
    )


def _held_out(x: np.ndarray, z: np.ndarray, scale: float, settings: Settings) -> np.ndarray:
    """Give the mean squared error of every output on every other stretch of the frames."""
    stretch = min(STRETCH, max(1, len(x) // 4))
    held = np.arange(len(x)) // stretch % 2 == 1
    fitted = np.flatnonzero(~held)
    fitted = fitted[:: max(1, round(len(fitted) / FITTED))]
    length = scale * median_distance(x)
    relevant = _search(basis_functions(x[fitted], x[fitted], length), z[fitted], settings)
    phi = basis_functions(x[held], x[fitted], length)[:, relevant.kept]
    return ((relevant.predict(phi)[0] - z[held]) ** 2).mean(axis=0)


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
    x = rooted(features(descriptors, mixture))
    regressor = train_regressor(x, angles, labels, settings, say)
    seconds = time.perf_counter() - began
    return VoxelPose(settings, mixture, regressor, skeleton, dict(rest), seed, seconds)
