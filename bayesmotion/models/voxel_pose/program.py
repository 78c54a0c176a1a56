"""Poses from voxels (Sun et al. 2006): a mixture of PPCA, and relevance vectors on its features.

Descriptors d of the voxels of every frame are given. A sample t of those of the training
frames is explained by a mixture of PPCA, and the principal components of the poses by relevance
vectors on the roots of the frames' mean responsibilities:

    t_i ~ sum_k pi_k N(mu_k, W_k W_k^T + sigma_k^2 I)                    (`mixture_ppca`)
    x_f = sqrt(mean over the descriptors d of frame f of p(k | d))       (eq. 5)
    l = length * median distance of the x,    length ~ LogNormal(log 0.7, 0.5)
    Phi_f0 = 1,    Phi_fb = exp(-|x_f - x_b|^2 / (2 l^2))
    pose_fp = sum_b Phi_fb W_bp + noise_fp                               (`relevance_vectors`)

All of it is one program: poses depend on the mixture through the features, so that in `map`
and `nuts` poses have a say in where the components lie. The paper's estimate, `em`, cuts
that feedback: the mixture is fitted to the descriptors alone, by EM, then the regression to its
features, by fast marginal likelihood, with the length that does best on frames held out. Where
descriptors are many more than poses the mixture is the same either way.

Of new frames descriptors are given too; what is new is the pose.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jax.scipy.special import logsumexp
from jaxtyping import Array, Float, PRNGKeyArray
from numpyro import distributions as dist
from numpyro import handlers

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import About, PointEstimate, Progress, SBCCase, Values
from ...motion.io.recordings import read_clips
from ...search_state import SearchState
from ...sensing.voxels.cameras import circle
from ...sensing.voxels.shape_context import ShapeContext
from . import sbc
from .data import Frames, PoseData, prepare_frames, voxel_recordings
from .example import example
from .features import features
from .mixture_ppca import MixturePPCA
from .mixture_ppca.density import Mixture, PPCAMixture, latent
from .mixture_ppca.em import fit_mixture
from .regression import basis, median_distance, search
from .relevance_vectors import RelevanceVectors
from .relevance_vectors.data import Design
from .relevance_vectors.outputs import (
    MarginalOutputs,
    OutputsPredictive,
    TrainedWeights,
    prior_weights,
)
from .relevance_vectors.program import (
    determined,
    every_basis,
    initial,
    landmarks,
    marginal,
    sample_precisions,
)

# Median of the length's prior, in medians of distances, and the sd of its logarithm.
LENGTH, LENGTH_SD = 0.7, 0.5


class TrainedPose(NamedTuple):
    """The model at one draw.

    mixture
        Of the descriptors.
    centres, length_scale
        (B, K) features of the frames with basis functions, and the length of these.
    weights
        What the training poses say of the weights.
    held_out
        (P,) variances that predictions have at least.
    """

    mixture: Mixture
    centres: Float[AnyArray, "b k"]
    length_scale: Float[AnyArray, ""]
    weights: TrainedWeights
    held_out: Float[AnyArray, " p"]


@dataclass(frozen=True)
class VoxelPose:
    """The model with its settings; see the module for the equations.

    Parameters
    ----------
    context
        Bins of the descriptors.
    cell
        Side in voxels of the cubes basis voxels are chosen from.
    components, latent
        K and Q of the mixture.
    share
        Of the poses' variance that is regressed.
    mixture_points
        At most so many descriptors are explained by the mixture.
    least_noise
        Variance of the regression's noise, at least, as a share of an output's. The marginal
        likelihood takes the frames for independent, and likes no noise at all best.
    candidates
        At most so many training frames, evenly chosen, have basis functions.
    length
        Of the basis functions, in medians of the distances between training features; None
        where it is inferred (`em`: that which does best on frames held out).
    """

    context: ShapeContext = field(default_factory=ShapeContext)
    cell: int = 3
    components: int = 200
    latent: int = 5
    share: float = 0.9
    mixture_points: int = 50_000
    least_noise: float = 0.2
    candidates: int = 2400
    length: float | None = None

    name: ClassVar[str] = "voxel_pose"
    about: ClassVar[About] = About(
        "Sun et al. 2006",
        "voxels of frames (`voxel_recordings`) and joint angles",
        ("em", "map", "nuts", "ensemble"),
    )

    def __post_init__(self) -> None:
        """Check the settings once, those of both parts by these."""
        if min(self.mixture_points, self.candidates) < 1:
            raise InputError(
                "voxel_pose", f"{self.mixture_points} points, {self.candidates} candidates",
                "Give at least one of each",
            )  # fmt: skip
        length = LENGTH if self.length is None else self.length
        _ = self._mixture, RelevanceVectors(length, self.least_noise)

    @property
    def _mixture(self) -> MixturePPCA:
        return MixturePPCA(self.components, self.latent)

    @classmethod
    def example(cls, seed: int = 0) -> tuple["VoxelPose", xr.Dataset]:
        """Return a small model, and voxels of a synthetic walk with its poses."""
        model = cls(ShapeContext(2, 2, 3), cell=9, components=3, latent=1, share=0.7)
        return model, example(seed)

    @classmethod
    def read(
        cls,
        files: Sequence[Path],
        *,
        rate: float = 30.0,
        cameras: int = 6,
        drop: bool = False,
        frame_rate: float | None = None,
        skeleton: Path | None = None,
    ) -> xr.Dataset:
        """Read motion capture, and see it from cameras on a circle.

        Parameters
        ----------
        files
            Recordings: .amc, .bvh or a saved .nc.
        rate
            Frames a second that are kept, a whole part of those the recordings have.
        cameras
            How many stand around.
        drop
            Leave out suspicious frames.
        frame_rate
            Frames a second of the files, where they do not say or are wrong.
        skeleton
            The .asf file of .amc files.
        """
        motion = read_clips(files, rate=rate, drop=drop, frame_rate=frame_rate, skeleton=skeleton)
        return voxel_recordings(motion, circle(cameras))

    @classmethod
    def settings_for(cls, recordings: xr.Dataset) -> dict[str, Any]:
        """Return the settings that follow from recordings: none."""
        return {}

    def prepare(self, recordings: xr.Dataset, trained: PoseData | None = None) -> PoseData:
        """Describe voxels, and take poses to principal components.

        Parameters
        ----------
        recordings
            Voxels and angles, see `data`. A pose with an angle missing is missing as a whole;
            of new recordings all may be.
        trained
            The training data, for new recordings.

        Raises
        ------
        InputError
            If there are no voxels, a frame has none, or poses are lacking or of other angles.
        """
        return prepare_frames(
            recordings,
            self.context,
            self.cell,
            self.share,
            self.mixture_points,
            self.candidates,
            trained,
        )

    def program(self, frames: Frames, trained: TrainedPose | None = None) -> None:
        """Sample the descriptors' sample and the poses; of new frames the poses alone."""
        if trained is not None:
            self._new(frames, trained)
            return
        design, alpha, noise = self._sampled(frames)
        shape = [design.phi.shape[1], design.y.shape[1]]
        weights = dist.Normal(0.0, alpha[:, None] ** -0.5).expand(shape).to_event(2)
        W = jnp.asarray(numpyro.sample("weight", weights))
        seen = ~jnp.isnan(design.y)
        outputs = dist.Normal(design.phi @ W, jnp.sqrt(noise)).mask(seen)
        numpyro.sample("pose", outputs, obs=jnp.where(seen, design.y, 0.0))

    def collapsed(self, frames: Frames) -> None:
        """Sample the same with the weights integrated out."""
        design, alpha, noise = self._sampled(frames)
        numpyro.sample("pose", marginal(design, alpha, noise), obs=frames.pose)

    def _sampled(self, frames: Frames) -> tuple[Design, Array, Array]:
        """Sample all but weights and poses."""
        points = frames.points
        assert points is not None  # training frames have them
        with handlers.scope(prefix="mixture", divider="_"):
            mixture = self._mixture.sample_mixture(points)
        with numpyro.plate("point", len(points.t)):
            numpyro.sample("descriptor", PPCAMixture(mixture, len(points.t)), obs=points.t)
        length = self.length
        if length is None:
            prior = dist.LogNormal(np.log(LENGTH), LENGTH_SD)
            length = jnp.asarray(numpyro.sample("length", prior))
        design, *_ = _design(frames, mixture, length)
        alpha, noise = sample_precisions(design.phi.shape[1], design.y.shape[1], self.least_noise)
        return design, alpha, noise

    def _new(self, frames: Frames, trained: TrainedPose) -> None:
        phi = _phi(frames, trained)
        weight, root = trained.weights.posterior()
        noise = jnp.asarray(trained.weights.noise)
        numpyro.sample("pose", MarginalOutputs(phi @ weight.T, phi @ root, noise), obs=frames.pose)

    def complete_draw(
        self, key: PRNGKeyArray, frames: Frames, values: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Draw the weights given all else; return all of them."""
        mean, root = self.condition(frames, values).weights.posterior()
        white = jax.random.normal(key, mean.shape)
        return {**values, "weight": (mean + jnp.einsum("pbc,pc->pb", root, white)).T}

    def initial_values(
        self, data: PoseData, seed: int, count: int, trained: TrainedPose | None = None
    ) -> list[dict[str, np.ndarray]]:
        """Return clusters of descriptors and a ridge regression; nothing of new data."""
        if trained is not None:
            return [{} for _ in range(count)]
        found, points = [], data.frames.points
        assert points is not None
        for index in range(count):
            start = self._mixture.initial(points, seed + index)
            length = np.asarray(LENGTH if self.length is None else self.length)
            design, *_ = _design(data.frames, _mixture_of(start), length)
            random = np.random.default_rng(seed + index)
            phi, pose = np.asarray(design.phi), np.asarray(design.y)
            values = _prefixed(start) | initial(phi, pose, self.least_noise, random)
            found.append(values if self.length is not None else values | {"length": length})
        return found

    def em(
        self,
        data: PoseData,
        *,
        seed: int,
        max_steps: int,
        tolerance: float,
        progress: Progress | None = None,
        state: SearchState | None = None,
    ) -> PointEstimate:
        """Fit the mixture by EM, and the regression to its features by fast marginal likelihood.

        Parameters
        ----------
        data
            Training frames.
        seed
            Of k-means, where EM begins.
        max_steps
            At most so many steps of EM.
        tolerance
            Gain of the mixture's log likelihood, relative to its size, below which a step is the
            last.
        progress
            Called with the steps of EM and the log likelihood a descriptor.
        state
            Where an earlier EM stood, and where this one is kept; the regression, a matter of
            seconds, is done anew.

        Returns
        -------
        Beside the sites ``held_out``, the mean squared errors of the outputs on frames held
        out, which are the least variances of predictions. The log density is the sum of both
        parts', what either maximised.
        """
        frames = data.frames
        assert frames.points is not None
        points = np.asarray(frames.points.t)
        fitted = fit_mixture(
            points, self.components, self.latent, seed=seed, max_steps=max_steps,
            tolerance=tolerance, progress=progress, state=state,
        )  # fmt: skip
        x = np.asarray(_features(frames, fitted.mixture))
        found = search(
            x, np.asarray(frames.pose), data.space.scale, length=self.length,
            least_noise=self.least_noise, most=self.candidates,
        )  # fmt: skip
        values = _prefixed(fitted.mixture._asdict())
        values |= every_basis(found.relevant, 1 + len(found.centres), self.least_noise)
        values |= {"held_out": found.held_out}
        if self.length is None:
            values |= {"length": np.asarray(found.length)}
        steps = len(fitted.log_likelihood) - 1 + found.relevant.steps
        density = float(fitted.log_likelihood[-1]) + found.relevant.log_marginal
        converged = fitted.converged and found.relevant.converged
        return PointEstimate(values, density, steps, converged)

    def condition(self, frames: Frames, values: Mapping[str, AnyArray]) -> TrainedPose:
        """Return the model at one draw, the weights given it integrated out."""
        mixture = Mixture(*(jnp.asarray(values[f"mixture_{name}"]) for name in Mixture._fields))
        length = values["length"] if self.length is None else self.length
        design, centres, scale = _design(frames, mixture, length)
        alpha, noise = jnp.asarray(values["alpha"]), jnp.asarray(values["noise"])
        weights = prior_weights(alpha, noise).seeing(design.phi, design.y)
        held_out = jnp.asarray(values.get("held_out", jnp.zeros(len(noise))))
        return TrainedPose(mixture, centres, scale, weights, held_out)

    def predict(
        self, trained: TrainedPose, frames: Frames, values: Mapping[str, AnyArray]
    ) -> dict[str, OutputsPredictive]:
        """Predict the poses of frames, given those of them that are known."""
        phi = _phi(frames, trained)
        weight, root = trained.weights.seeing(phi, frames.pose).posterior()
        noise = jnp.asarray(trained.weights.noise)
        return {"pose": OutputsPredictive(phi, weight, root, noise, trained.held_out)}

    def joint_angles(
        self,
        training: PoseData,
        mean: Float[np.ndarray, "f p"],
        variance: Float[np.ndarray, "f p"],
    ) -> tuple[tuple[str, ...], Float[np.ndarray, "f a"], Float[np.ndarray, "f a"]]:
        """Return the labels of angles, and their values and standard deviations in radians."""
        space = training.space
        return space.labels, space.decode(mean), space.sd(mean, variance)

    def identified(self, frames: Frames, values: Mapping[str, AnyArray]) -> Values:
        """Return what data can tell of a draw, whatever the order of components.

        Of the mixture the log likelihood, weights and noises in order; of the regression
        noise, length, the poses' components without noise at some frames, log likelihood with
        the weights integrated out, and how many weights the data determine.
        """
        assert frames.points is not None
        trained = self.condition(frames, values)
        design, *_ = self._given(frames, values, trained)
        joint = latent(trained.mixture, frames.points.t).log_joint
        alpha, noise = jnp.asarray(values["alpha"]), jnp.asarray(values["noise"])
        some = landmarks(len(design.y))
        found = {
            "mixture_log_likelihood": logsumexp(joint, axis=1).sum(),
            "sorted_weight": jnp.sort(trained.mixture.weight),
            "sorted_noise": jnp.sort(trained.mixture.noise),
            "noise": noise,
            "signal": design.phi[some] @ jnp.asarray(values["weight"]),
            "log_likelihood": marginal(design, alpha, noise).log_prob(design.y),
            "effective_vectors": determined(trained.weights),
        }
        return (
            found if self.length is not None else found | {"length": jnp.asarray(values["length"])}
        )

    def pointwise(self, frames: Frames, values: Mapping[str, AnyArray]) -> Float[Array, " f"]:
        """Return the log density of every frame's pose given all other poses.

        Descriptors are given; the weights are integrated out.
        """
        design, alpha, noise = self._given(frames, values, self.condition(frames, values))
        return marginal(design, alpha, noise).leave_out(design.y)

    def _given(
        self, frames: Frames, values: Mapping[str, AnyArray], trained: TrainedPose
    ) -> tuple[Design, Array, Array]:
        design = Design(_phi(frames, trained), frames.pose)
        return design, jnp.asarray(values["alpha"]), jnp.asarray(values["noise"])

    def points(self, data: PoseData) -> dict[str, tuple[str, np.ndarray]]:
        """Return numbers and clips of the frames."""
        return {"frame": ("point", np.array(data.names)), "clip": ("point", data.clips)}

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the dimensions of every site and of what is identified."""
        return {
            "descriptor": ("point", "bin"),
            "pose": ("frame", "output"),
            "mixture_weight": ("component",),
            "mixture_mean": ("component", "bin"),
            "mixture_factor": ("component", "bin", "latent"),
            "mixture_noise": ("component",),
            "length": (),
            "alpha": ("basis",),
            "noise": ("output",),
            "weight": ("basis", "output"),
            "held_out": ("output",),
            "mixture_log_likelihood": (),
            "sorted_weight": ("rank",),
            "sorted_noise": ("rank",),
            "signal": ("landmark", "output"),
            "log_likelihood": (),
            "effective_vectors": ("output",),
        }

    def coords(self, data: PoseData) -> dict[str, list]:
        """Return the labels of every dimension."""
        frames = data.frames
        centres = [] if frames.centres is None else [data.names[i] for i in frames.centres]
        return {
            "frame": list(data.names),
            "output": data.components,
            "point": list(range(0 if frames.points is None else len(frames.points.t))),
            "bin": list(range(self.context.bins)),
            "component": list(range(self.components)),
            "latent": list(range(self.latent)),
            "rank": list(range(self.components)),
            "basis": ["constant", *map(str, centres)],
            "landmark": [data.names[i] for i in landmarks(len(data.names))],
        }

    def sbc_case(self) -> tuple[SBCCase, Frames]:
        """Return two components of one direction each in the plane, and eight frames."""
        return sbc.case(self)


def _features(frames: Frames, mixture: Mixture) -> Float[Array, "f k"]:
    return features(mixture, frames.descriptors, frames.frame, len(frames.pose))


def _design(
    frames: Frames, mixture: Mixture, length: AnyArray | float
) -> tuple[Design, Array, Array]:
    """Return basis functions and poses of training frames, centres, and the length scale."""
    x = _features(frames, mixture)
    assert frames.centres is not None
    centres, scale = x[jnp.asarray(frames.centres)], median_distance(x) * jnp.asarray(length)
    return Design(basis(x, centres, scale), frames.pose), centres, scale


def _phi(frames: Frames, trained: TrainedPose) -> Float[Array, "f b"]:
    return basis(_features(frames, trained.mixture), trained.centres, trained.length_scale)


def _mixture_of(values: Mapping[str, AnyArray]) -> Mixture:
    return Mixture(*(jnp.asarray(values[name]) for name in Mixture._fields))


def _prefixed(values: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    return {f"mixture_{name}": value for name, value in values.items()}
