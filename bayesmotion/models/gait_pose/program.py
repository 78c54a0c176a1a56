"""Joint gait-pose manifolds (Ding and Fan 2015) and the models they are compared with.

Cycles of P poses of G gaits in S layers, stride scales, are N = S G P poses. Each has
a latent point x in R^3, and the pose is a function of it (eq. 11):

    y_d ~ GP(0, k),   k = variance exp(-gamma / 2 |x - x'|^2) + delta / beta

for every feature alike: features are in millimetres (`encoding`), so that one
variance and one noise serve all (`hyperparameters`). The latent points, by the model's
settings:

    Torus, Cylinder      x around the ideal surface: `distributions.topology`, p(X | W)
    PoseCircle           the pose is around a circle, gaits are not ordered
    NoSurface            x ~ N(0, latent_sd^2)
    PathDynamics         and p(X) times the density of Gaussian process dynamics
                         of first order (`distributions.dynamics`), at unit scale
    OnTorus, OnCylinder  x on the surface itself, at coordinates that are free:

        phase_c  ~ N(0, phase_sd^2)                   poses that cycle c is ahead
        gait_g   ~ N(g, gait_sd^2)                    where along the tour or path a gait lies
        radius_s ~ LogNormal(log r_s, radius_sd^2)    of every layer

k of points on a circle is the periodic kernel of their angle (MacKay 1998). Without
dynamics all priors are proper. The product of the topology's density and the dynamics'
(eq. 14) has no normaliser that is known: the site ``dynamics`` is a factor. With `alpha`
fixed the normaliser depends on nothing that is unknown.

Cycles of several scales are made of those recorded by eq. 5 (`data.layered`). What a new
cycle has of its own, and its program: `prediction`. Named settings of the study:
`variants.VARIANTS`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Array, Float
from numpyro import distributions as dist

from ...distributions.dynamics import GPDynamics, unit_scale
from ...distributions.topology import LocallyLinear
from ...errors import InputError
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import GaussianProcess
from ...gp.unnormalised import NoDensity, factor
from ...model import About, PointEstimate, Progress, SBCCase, Values
from ...motion.cycles import POSES, cycles_of
from ...motion.io.reading import read
from ...motion.io.recordings import given, looked_over
from ...motion.joining import concat
from ...prediction import Predictive
from ...search_state import SearchState
from . import identified, prediction
from .data import Cycles, GaitData, prepare_new, prepare_training
from .example import example_cycles
from .hyperparameters import (
    ALPHA_MEDIAN,
    ALPHA_PARTS,
    alpha_prior,
    covariance,
    initial,
    sample_hyperparameters,
)
from .local_learning import PATCH, RATE, learn_locally
from .sbc import sbc_case, small_cycles
from .settings import (
    Around,
    LatentSpace,
    NoSurface,
    PathDynamics,
    Torus,
)
from .surfaces import coordinates, sample_on_surface

PRODUCT = NoDensity(
    "the density of the dynamics multiplies that of the latent points, and the product's "
    "constant, which depends on alpha, is not known",
    "Use a model without dynamics, method map, or fix alpha",
    ("alpha",),
)


@dataclass(frozen=True)
class GaitPose:
    """A gait-pose model with its settings; see the module for the equations.

    Parameters
    ----------
    surface
        What latent points keep to.
    scales
        Stride scales of the layers, growing: the recorded cycles are repeated at every
        one of them (eq. 5).
    dynamics
        Of the latent path of a cycle; None for none.
    subject_noise_sd
        Standard deviation of what is a person's own, of features of mean square one: noise
        to the process that predicts new people's poses (`prediction`), no part of the
        density of training cycles.
    """

    surface: LatentSpace = field(default=Torus())
    scales: tuple[float, ...] = (1.0,)
    dynamics: PathDynamics | None = None
    subject_noise_sd: float = 0.05**0.5

    name: ClassVar[str] = "gait_pose"
    about: ClassVar[About] = About(
        "Ding and Fan 2015",
        "gait cycles of people on one body, all of as many poses",
        ("map", "nuts", "ensemble", "local"),
    )

    def __post_init__(self) -> None:
        """Refuse layers that do not lie around each other."""
        if not self.scales or list(self.scales) != sorted(set(self.scales)) or self.scales[0] <= 0:
            raise InputError(
                f"scales {list(self.scales)}", "they do not grow", "Give each once, in order"
            )
        if self.subject_noise_sd < 0:
            raise InputError(
                "subject_noise_sd", f"it is {self.subject_noise_sd}", "Give no number below zero"
            )

    @classmethod
    def example(cls, seed: int = 0) -> tuple["GaitPose", xr.Dataset]:
        """Return a small model and gait cycles of synthetic people."""
        return cls(), example_cycles(seed)

    @classmethod
    def read(
        cls,
        files: Sequence[Path],
        *,
        cycles: int = 3,
        poses: int = POSES,
        drop: bool = False,
        frame_rate: float | None = None,
        skeleton: Path | None = None,
        joints: Path | None = None,
    ) -> xr.Dataset:
        """Read walks, and cut their straight gait cycles.

        Parameters
        ----------
        files
            Recordings of people walking: .amc, .bvh or a saved .nc.
        cycles
            Taken of each clip at most, the straightest ones.
        poses
            Of every cycle.
        drop
            Leave out suspicious frames.
        frame_rate
            Frames a second of the files, where they do not say or are wrong.
        skeleton
            The .asf file of .amc files.
        joints
            A csv table role,joint of joints whose names do not tell what they are.
        """
        options = given(frame_rate=frame_rate, skeleton=skeleton, joints=joints)
        walks = [looked_over(read(path, **options), dropping=drop) for path in files]
        return concat([cycles_of(walk, cycles, poses) for walk in walks])

    @classmethod
    def settings_for(cls, recordings: xr.Dataset) -> dict[str, Any]:
        """Return the settings that follow from recordings: none."""
        return {}

    def prepare(self, recordings: xr.Dataset, trained: GaitData | None = None) -> GaitData:
        """Make cycles into arrays.

        Parameters
        ----------
        recordings
            Cycles on one skeleton, as `motion.cycles.cycles_of` cuts them; NaN is missing.
        trained
            Training data, in whose units new cycles are described; None for training
            cycles, which are repeated at the model's scales.

        Raises
        ------
        InputError
            If the cycles are not on one skeleton, or differ in their number of poses.
        """
        if trained is not None:
            return prepare_new(recordings, trained)
        return prepare_training(recordings, self.surface, self.scales)

    def program(self, frames: Cycles, trained: prediction.LatentGP | None = None) -> None:
        """Generate the features `frames.y` (N, D), of new cycles given the trained model."""
        if trained is not None:
            prediction.new_cycles_program(frames, trained)
            return
        hyper = sample_hyperparameters()
        x = self._points(frames)
        K = covariance(hyper, x)
        outputs = GaussianProcess(K, jnp.ones(frames.y.shape[1]), None, frames.missing)
        numpyro.sample("y", outputs, obs=frames.y)

    def _points(self, frames: Cycles) -> Float[AnyArray, "n q"]:
        surface = self.surface
        if isinstance(surface, NoSurface):
            shape = (frames.y.shape[0], surface.latent_size)
            free = dist.Normal(0.0, surface.latent_sd).expand(shape).to_event(2)
            x = jnp.asarray(numpyro.sample("x", free))
        elif isinstance(surface, Around):
            prior = LocallyLinear(
                frames.topology, surface.sigma, surface.latent_sd, frames.normaliser
            )
            x = jnp.asarray(numpyro.sample("x", prior))
        else:
            assert frames.surface is not None
            on = sample_on_surface(frames.surface, surface)
            x = jnp.asarray(numpyro.deterministic("x", on))
        if self.dynamics is not None:
            known = self.dynamics.alpha
            alpha = numpyro.sample("alpha", alpha_prior()) if known is None else np.asarray(known)
            alpha = jnp.append(jnp.asarray(alpha), self.dynamics.noise_sd**-2)
            path = GPDynamics(alpha, frames.steps, x.shape)
            factor("dynamics", path.log_prob(unit_scale(x, frames.steps)), PRODUCT)
        return x

    def initial_values(
        self,
        data: GaitData,
        seed: int,
        count: int,
        trained: prediction.LatentGP | None = None,
    ) -> list[dict[str, np.ndarray]]:
        """Return values of the sites to begin the search for the mode from.

        The first of training cycles is the ideal surface, the others lie around it; those of
        new cycles are paths of training cycles, the likeliest first.
        """
        if trained is not None:
            return prediction.new_cycle_starts(trained, data.frames, seed, count)
        random = np.random.default_rng(seed)
        start = data.ideal()
        out = []
        for number in range(count):
            spread = 0.1 if number else 0.0
            values = initial()
            if self._free:
                values["x"] = start + spread * random.normal(size=start.shape)
            else:
                assert data.surface is not None
                values |= coordinates(data.surface, spread, random)
            if self.dynamics is not None and self.dynamics.alpha is None:
                values["alpha"] = np.array(ALPHA_MEDIAN)
            out.append(values)
        return out

    def condition(self, frames: Cycles, values: Mapping[str, AnyArray]) -> prediction.LatentGP:
        """Condition on training cycles and trained site values (one draw)."""
        return prediction.condition(frames, values, self.subject_noise_sd)

    def condition_on_some(
        self, frames: Cycles, values: Mapping[str, AnyArray], cycles: Float[AnyArray, " c"]
    ) -> prediction.LatentGP:
        """Condition on some of the training cycles, 1 for those and 0 for the others."""
        return prediction.condition(frames, values, self.subject_noise_sd, cycles)

    def predict(
        self, trained: prediction.LatentGP, frames: Cycles, values: Mapping[str, AnyArray]
    ) -> dict[str, Predictive]:
        """Predict every entry of new cycles, conditioned on what is seen of them."""
        return {"y": prediction.predict(trained, frames, values)}

    def identified(self, frames: Cycles, values: Mapping[str, AnyArray]) -> Values:
        """Return what the data can tell of one draw; see the module `identified`."""
        return identified.identified(frames, values, gamma=not self._free)

    @property
    def _free(self) -> bool:
        """Whether the scale of latent points is free: then gamma says nothing by itself."""
        return isinstance(self.surface, NoSurface | Around)

    def pointwise(self, frames: Cycles, values: Mapping[str, AnyArray]) -> Float[Array, " n"]:
        """Return log p(y_i | y_-i, theta) of every recorded pose, left out of all layers."""
        return identified.pointwise(frames, values, len(self.scales))

    def points(self, data: GaitData) -> dict[str, tuple[str, np.ndarray]]:
        """Return clip and pose of every point."""
        return identified.points(data)

    def local_learning(
        self, data: GaitData, *, seed: int, sweeps: int, progress: Progress | None = None,
        state: SearchState | None = None, patch: int = PATCH, rate: float = RATE,
    ) -> PointEstimate:  # fmt: skip
        """Fit by steps on patches of the surface; see the module `local_learning`.

        Raises
        ------
        InputError
            If latent points are not free around a surface, have dynamics, or entries are
            missing.
        """
        surface = self.surface
        if not isinstance(surface, Around) or self.dynamics is not None:
            raise InputError(
                f"model {self}",
                "local learning cuts a surface with free points into patches, and paths into "
                "pieces",
                "Use a model with points around a surface, without dynamics, or method 'map'",
            )
        start = self.initial_values(data, seed, 1)[0]
        return learn_locally(
            self.program, surface, data.frames, start,
            seed=seed, sweeps=sweeps, patch=patch, rate=rate, progress=progress, state=state,
        )  # fmt: skip

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the dimensions of every site, and of identified quantities."""
        sites = {
            "y": ("frame", "feature"),
            "variance": (),
            "gamma": (),
            "beta": (),
            "alpha": ("alpha_part",),
            "x": ("frame", "latent"),
            "phase": ("cycle",),
            "gait": ("gait_name",),
            "radius": ("layer",),
        }
        return sites | identified.DIMS

    def coords(self, data: GaitData) -> dict[str, list]:
        """Return the labels of every dimension."""
        n = data.frames.y.shape[0]
        q = self.surface.latent_size if isinstance(self.surface, NoSurface) else 3
        return {
            "feature": data.encoding.labels,
            "alpha_part": ALPHA_PARTS,
            "frame": list(range(n)),
            "latent": list(range(q)),
            "cycle": [f"{gait} x{scale:g}" for scale in data.scales for gait in data.gaits],
            "gait_name": list(data.gaits),
            "layer": list(data.scales),
            **identified.pair_labels(n),
        }

    def sbc_case(self) -> tuple[SBCCase, Cycles]:
        """Return these settings on two gaits of five poses.

        Raises
        ------
        InputError
            If the model has dynamics.
        """
        if self.dynamics is not None:
            raise InputError(
                "dynamics of the latent path",
                f"{PRODUCT.what}: there is no normaliser to draw by",
                "Use a model without dynamics",
            )
        return sbc_case(self), small_cycles(self.surface, self.scales)
