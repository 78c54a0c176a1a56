"""The regressions the voxel study compares, and how they are scored.

`rvm_mppca` is the paper's. `rvm_kmeans` has k-means votes for features, `ridge` and
`nearest` the paper's features and a linear or no regression, `moments` relevance vectors
on the silhouettes' moments, camera by camera, without any voxels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from jaxtyping import Float

from ...intervals import NINETY
from ...models.clusters import Clusters, nearest_centre
from ...models.voxel_pose import VoxelPose
from ...models.voxel_pose.features import Descriptors, describe, mean_shares
from ...models.voxel_pose.joint_angles import absolute_degrees, rms_degrees, turned_degrees, wrapped
from ...models.voxel_pose.mixture_ppca.density import Mixture
from ...models.voxel_pose.mixture_ppca.em import responsibilities
from ...models.voxel_pose.pose_space import PoseSpace, learn_space
from ...models.voxel_pose.regression import search
from ...models.voxel_pose.relevance_vectors.data import basis_functions
from ...models.voxel_pose.relevance_vectors.fast import Relevant
from ...motion import Skeleton
from ..stages import Say
from .data import Seen

Angles = Float[np.ndarray, "f a"]
MODELS = ("rvm_mppca", "rvm_kmeans", "ridge", "nearest", "moments")
# What Table 1 tells apart.
PARTS = {"heading": ("root/heading",), "left_shoulder": ("lhumerus",), "right_hip": ("rfemur",)}
PENALTIES = np.geomspace(1e-6, 1e2, 17)


@dataclass(frozen=True)
class Inputs:
    """What regressions see of F frames: roots of features (F, K) of either kind, moments (F, m)."""

    mppca: Float[np.ndarray, "f k"]
    kmeans: Float[np.ndarray, "f k"]
    moments: Float[np.ndarray, "f m"]

    @property
    def parts(self) -> tuple[np.ndarray, ...]:
        """All three, in the order of the class."""
        return self.mppca, self.kmeans, self.moments


@dataclass(frozen=True)
class Regressor:
    """Relevance vectors from features, of whatever kind, to poses.

    space
        The poses' principal components.
    vectors
        (A, F) features of the training frames kept; NaN in the row of the constant.
    length_scale
        Of the basis functions.
    relevant
        The regression.
    held_out
        (P,) mean squared errors of the outputs on training frames held out.
    frames
        How many training frames there were.
    """

    space: PoseSpace
    vectors: Float[np.ndarray, "a f"]
    length_scale: float
    relevant: Relevant
    held_out: Float[np.ndarray, " p"]
    frames: int

    @classmethod
    def of(
        cls, x: Float[np.ndarray, "f k"], angles: Angles, labels: Sequence[str],
        model: VoxelPose, say: Say | None = None,
    ) -> "Regressor":  # fmt: skip
        """Find it with the settings of a model, by the search that `VoxelPose.em` ends with."""
        space = learn_space(angles, labels, model.share)
        found = search(
            x, space.encode(angles), space.scale, length=model.length,
            least_noise=model.least_noise, most=model.candidates, log=say,
        )  # fmt: skip
        kept = found.relevant.kept
        vectors = np.full((len(kept), x.shape[1]), np.nan)
        vectors[kept > 0] = x[found.centres[kept[kept > 0] - 1]]
        return cls(space, vectors, found.length_scale, found.relevant, found.held_out, len(x))

    def outputs(
        self, x: Float[np.ndarray, "f k"]
    ) -> tuple[Float[np.ndarray, "f p"], Float[np.ndarray, "f p"]]:
        """Return z and its variances, which are not less than the errors on frames held out."""
        constant = np.isnan(self.vectors[:, 0])
        phi = np.ones((len(x), len(self.vectors)))
        full = basis_functions(x, self.vectors[~constant], self.length_scale)
        phi[:, ~constant] = full[:, 1:]
        z, variance = self.relevant.predict(phi)
        return z, np.maximum(variance, self.held_out)

    def __call__(self, x: Float[np.ndarray, "f k"]) -> tuple[Angles, Angles]:
        """Return the angles of poses, and their standard deviations, in radians."""
        z, variance = self.outputs(x)
        return self.space.decode(z), self.space.sd(z, variance)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all of it as arrays, for a file."""
        parts = {"space": vars(self.space), "relevant": vars(self.relevant)}
        own = {n: v for n, v in vars(self).items() if n not in parts}
        nested = {f"{part}_{n}": v for part, values in parts.items() for n, v in values.items()}
        return {name: np.asarray(value) for name, value in (own | nested).items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> "Regressor":
        """Make it of what `arrays` gave."""

        def part(name: str) -> dict[str, Any]:
            start = f"{name}_"
            found = {n.removeprefix(start): v for n, v in arrays.items() if n.startswith(start)}
            return {n: v.item() if v.ndim == 0 else v for n, v in found.items()}

        space = part("space")
        labels = tuple(map(str, space.pop("labels")))
        return cls(
            PoseSpace(labels, **space),
            arrays["vectors"],
            float(arrays["length_scale"]),
            Relevant(**part("relevant")),
            arrays["held_out"],
            int(arrays["frames"]),
        )


@dataclass(frozen=True)
class Recognizer:
    """The paper's model as trained: the estimate of `VoxelPose.em`, on frames too many to hold.

    model
        Its settings.
    mixture, regressor
        Of the descriptors, and from features to poses.
    skeleton, rest
        What a recognised pose is put on, and the mean angle in radians of the degrees of
        freedom that are not recognised.
    seconds
        Of the training.
    """

    model: VoxelPose
    mixture: Mixture
    regressor: Regressor
    skeleton: Skeleton
    rest: Mapping[str, float]
    seconds: float

    def __call__(self, descriptors: Descriptors) -> tuple[Angles, Angles]:
        """Return the angles of every frame and their standard deviations, in radians."""
        return self.regressor(features_of(descriptors, self.mixture))


def features_of(descriptors: Descriptors, shares: Mixture | Clusters) -> Float[np.ndarray, "f k"]:
    """Return roots of mean responsibilities, or of votes, a frame each."""
    if isinstance(shares, Clusters):
        return np.sqrt(mean_shares(descriptors, shares.votes))
    return np.sqrt(mean_shares(descriptors, lambda part: responsibilities(shares, part)))


@dataclass(frozen=True)
class Ridge:
    """Linear regression of poses with a penalty chosen by generalised cross-validation."""

    space: PoseSpace
    mean: Float[np.ndarray, " k"]
    weight: Float[np.ndarray, "k p"]

    @classmethod
    def of(cls, x: Float[np.ndarray, "f k"], angles: Angles, labels: Sequence[str]) -> "Ridge":
        """Fit it."""
        space = learn_space(angles, labels)
        z = space.encode(angles)
        mean = x.mean(axis=0)
        U, s, V = np.linalg.svd(x - mean, full_matrices=False)
        scores = []
        for penalty in PENALTIES * s[0] ** 2 / len(x):
            kept = s**2 / (s**2 + penalty)
            left = ((z - U @ (kept[:, None] * (U.T @ z))) ** 2).sum()
            scores.append(left / (len(x) - 1 - kept.sum()) ** 2)
        best = PENALTIES[int(np.argmin(scores))] * s[0] ** 2 / len(x)
        return cls(space, mean, V.T @ ((s / (s**2 + best))[:, None] * (U.T @ z)))

    def __call__(self, x: Float[np.ndarray, "f k"]) -> Angles:
        """Return angles in radians."""
        return self.space.decode((x - self.mean) @ self.weight)


@dataclass(frozen=True)
class Nearest:
    """The pose of the nearest training frame."""

    x: Float[np.ndarray, "n k"]
    angles: Float[np.ndarray, "n a"]

    def __call__(self, x: Float[np.ndarray, "f k"]) -> Angles:
        """Return angles in radians."""
        return self.angles[nearest_centre(x, self.x)]


@dataclass(frozen=True)
class Scaled:
    """Moments in units of their standard deviations in training."""

    mean: Float[np.ndarray, " m"]
    sd: Float[np.ndarray, " m"]

    @classmethod
    def of(cls, moments: Float[np.ndarray, "n m"]) -> "Scaled":
        """Learn it."""
        return cls(moments.mean(axis=0), np.maximum(moments.std(axis=0), 1e-9))

    def __call__(self, moments: Float[np.ndarray, "f m"]) -> Float[np.ndarray, "f m"]:
        """Scale."""
        return (moments - self.mean) / self.sd


@dataclass(frozen=True)
class Contest:
    """All models, trained.

    regressors
        By name: those that give standard deviations too.
    ridge, nearest
        On the mixture's features.
    scaled
        For the moments.
    """

    regressors: Mapping[str, Regressor]
    ridge: Ridge
    nearest: Nearest
    scaled: Scaled

    def __call__(self, inputs: Inputs) -> dict[str, Angles]:
        """Return every model's angles in radians; moments of other cameras mean nothing."""
        found = {
            "rvm_mppca": self.regressors["rvm_mppca"](inputs.mppca)[0],
            "rvm_kmeans": self.regressors["rvm_kmeans"](inputs.kmeans)[0],
            "ridge": self.ridge(inputs.mppca),
            "nearest": self.nearest(inputs.mppca),
        }
        if inputs.moments.shape[1] == len(self.scaled.mean):
            found["moments"] = self.regressors["moments"](self.scaled(inputs.moments))[0]
        return found


def inputs_of(seen: Seen, described: Descriptors, mixture: Mixture, clusters: Clusters) -> Inputs:
    """Make what was seen into what the regressions see."""
    mppca, kmeans = (features_of(described, one) for one in (mixture, clusters))
    return Inputs(mppca, kmeans, seen.moments)


def inputs_in_parts(
    seen: Seen, model: VoxelPose, mixture: Mixture, clusters: Clusters, frames: int = 200
) -> Inputs:
    """Describe frames and make them into what the regressions see, some frames at a time."""
    hulls, parts = seen.hulls(), []
    while some := list(islice(hulls, frames)):
        described = describe(some, model.context, model.cell)
        parts.append([features_of(described, one) for one in (mixture, clusters)])
    mppca, kmeans = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    return Inputs(mppca, kmeans, seen.moments)


def errors(true: Angles, found: Mapping[str, Angles]) -> dict[str, float]:
    """Return the error of every model in degrees."""
    return {name: rms_degrees(true, one) for name, one in found.items()}


def absolute(true: Angles, found: Mapping[str, Angles]) -> dict[str, float]:
    """Return the error of every model in degrees as in the paper's eq. 6."""
    return {name: absolute_degrees(true, one) for name, one in found.items()}


def turned(true: Angles, found: Mapping[str, Angles]) -> dict[str, float]:
    """Return how far every model's joints are turned off, in degrees."""
    return {name: turned_degrees(true, one) for name, one in found.items()}


def parts(true: Angles, found: Mapping[str, Angles], labels: Sequence[str]) -> dict:
    """Return the errors of Table 1: of the whole body, the heading, a shoulder and a hip.

    Parts that the skeleton has no angles of are left out.
    """
    out = {"full_body": errors(true, found)}
    for part, names in PARTS.items():
        own = [i for i, label in enumerate(labels) if label.startswith(names)]
        if own:
            out[part] = errors(true[:, own], {name: one[:, own] for name, one in found.items()})
    return out


def coverage(true: Angles, found: Angles, sd: Angles) -> float:
    """Return the share of angles within their 90 % intervals, of those that ever move."""
    moves = sd.max(axis=0) > 1e-6
    return float((np.abs(wrapped(true - found)) < NINETY * sd)[:, moves].mean())


def means(table: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Average over the motions."""
    names = next(iter(table.values()))
    return {name: float(np.mean([row[name] for row in table.values()])) for name in names}
