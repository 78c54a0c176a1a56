"""The regressions the voxel study compares, and how they are scored.

`rvm_mppca` is the paper's. `rvm_kmeans` has k-means votes for features, `ridge` and
`nearest` the paper's features and a linear or no regression, `moments` relevance vectors
on the silhouettes' moments, camera by camera, without any voxels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from jaxtyping import Float

from ..intervals import NINETY
from ..models.clusters import Clusters, squared_distances
from ..models.joint_angles import absolute_degrees, rms_degrees, turned_degrees, wrapped
from ..models.mixture_em import Mixture
from ..models.pose_space import PoseSpace, learn_space
from ..tasks.voxel_features import Descriptors, describe, features, rooted
from ..tasks.voxel_pose import Regressor, Settings
from .voxel_data import Seen

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
class Ridge:
    """Linear regression of poses with a penalty chosen by generalised cross-validation."""

    space: PoseSpace
    middle: Float[np.ndarray, " k"]
    weight: Float[np.ndarray, "k p"]

    @classmethod
    def of(cls, x: Float[np.ndarray, "f k"], angles: Angles, labels: Sequence[str]) -> "Ridge":
        """Fit it."""
        space = learn_space(angles, labels)
        z = space.encode(angles)
        middle = x.mean(axis=0)
        U, s, V = np.linalg.svd(x - middle, full_matrices=False)
        scores = []
        for penalty in PENALTIES * s[0] ** 2 / len(x):
            kept = s**2 / (s**2 + penalty)
            left = ((z - U @ (kept[:, None] * (U.T @ z))) ** 2).sum()
            scores.append(left / (len(x) - 1 - kept.sum()) ** 2)
        best = PENALTIES[int(np.argmin(scores))] * s[0] ** 2 / len(x)
        return cls(space, middle, V.T @ ((s / (s**2 + best))[:, None] * (U.T @ z)))

    def __call__(self, x: Float[np.ndarray, "f k"]) -> Angles:
        """Give angles in radians."""
        return self.space.decode((x - self.middle) @ self.weight)


@dataclass(frozen=True)
class Nearest:
    """The pose of the nearest training frame."""

    x: Float[np.ndarray, "n k"]
    angles: Float[np.ndarray, "n a"]

    def __call__(self, x: Float[np.ndarray, "f k"]) -> Angles:
        """Give angles in radians."""
        return self.angles[squared_distances(x, self.x).argmin(axis=1)]


@dataclass(frozen=True)
class Scaled:
    """Moments in units of their spread in training."""

    middle: Float[np.ndarray, " m"]
    spread: Float[np.ndarray, " m"]

    @classmethod
    def of(cls, moments: Float[np.ndarray, "n m"]) -> "Scaled":
        """Learn it."""
        return cls(moments.mean(axis=0), np.maximum(moments.std(axis=0), 1e-9))

    def __call__(self, moments: Float[np.ndarray, "f m"]) -> Float[np.ndarray, "f m"]:
        """Scale."""
        return (moments - self.middle) / self.spread


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
        """Give every model's angles in radians; moments of other cameras mean nothing."""
        found = {
            "rvm_mppca": self.regressors["rvm_mppca"](inputs.mppca)[0],
            "rvm_kmeans": self.regressors["rvm_kmeans"](inputs.kmeans)[0],
            "ridge": self.ridge(inputs.mppca),
            "nearest": self.nearest(inputs.mppca),
        }
        if inputs.moments.shape[1] == len(self.scaled.middle):
            found["moments"] = self.regressors["moments"](self.scaled(inputs.moments))[0]
        return found


def inputs_of(seen: Seen, described: Descriptors, mixture: Mixture, clusters: Clusters) -> Inputs:
    """Make what was seen into what the regressions see."""
    mppca, kmeans = (rooted(features(described, one)) for one in (mixture, clusters))
    return Inputs(mppca, kmeans, seen.moments)


def inputs_in_parts(
    seen: Seen, settings: Settings, mixture: Mixture, clusters: Clusters, frames: int = 200
) -> Inputs:
    """Describe frames and make them into what the regressions see, some frames at a time."""
    hulls, parts = seen.hulls(), []
    while some := list(islice(hulls, frames)):
        described = describe(some, settings.context, settings.cell)
        parts.append(inputs_of(seen, described, mixture, clusters))
    mppca, kmeans = (np.concatenate([part.parts[i] for part in parts]) for i in (0, 1))
    return Inputs(mppca, kmeans, seen.moments)


def errors(true: Angles, found: Mapping[str, Angles]) -> dict[str, float]:
    """Give the error of every model in degrees."""
    return {name: rms_degrees(true, one) for name, one in found.items()}


def absolute(true: Angles, found: Mapping[str, Angles]) -> dict[str, float]:
    """Give the error of every model in degrees as in the paper's eq. 6."""
    return {name: absolute_degrees(true, one) for name, one in found.items()}


def turned(true: Angles, found: Mapping[str, Angles]) -> dict[str, float]:
    """Give how far every model's joints are turned off, in degrees."""
    return {name: turned_degrees(true, one) for name, one in found.items()}


def parts(true: Angles, found: Mapping[str, Angles], labels: Sequence[str]) -> dict:
    """Give the errors of Table 1: of the whole body, the heading, a shoulder and a hip.

    Parts that the skeleton has no angles of are left out.
    """
    out = {"full_body": errors(true, found)}
    for part, names in PARTS.items():
        own = [i for i, label in enumerate(labels) if label.startswith(names)]
        if own:
            out[part] = errors(true[:, own], {name: one[:, own] for name, one in found.items()})
    return out


def coverage(true: Angles, found: Angles, spread: Angles) -> float:
    """Give the share of angles within their 90 % intervals, of those that ever move."""
    moves = spread.max(axis=0) > 1e-6
    return float((np.abs(wrapped(true - found)) < NINETY * spread)[:, moves].mean())


def means(table: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Average over the motions."""
    names = next(iter(table.values()))
    return {name: float(np.mean([row[name] for row in table.values()])) for name in names}
