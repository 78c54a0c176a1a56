"""Joint gait-pose manifolds (Ding and Fan 2015) and the models they are compared with.

Cycles of P poses of G gaits in S layers, stride scales, are N = S G P poses. Each has
a latent point x in R^3, and the pose is a function of it (eq. 11):

    y_d ~ GP(0, k),   k = variance exp(-gamma / 2 |x - x'|^2) + delta / beta

for every feature alike: features are in millimetres (`gait_cycles`), so that one
variance and one noise serve all. The latent points, by the model's settings:

    surface = torus, cylinder    x near the ideal surface: `priors.topology`, p(X | W)
              circle             the pose is on a circle, gaits are not ordered
              none               x ~ N(0, breadth^2)
    dynamics = True              and p(X) times the density of Gaussian process dynamics
                                 of first order (`priors.dynamics`), at unit scale
    on = True                    x on the surface itself, at coordinates that are free:

        phase_c ~ N(0, 1)                  poses that cycle c is ahead
        gait_g ~ N(g, 1)                   where along the tour or the path a gait lies
        radius_s ~ LogNormal(log r_s, 0.2) of every layer

k of points on a circle is the periodic kernel of their angle (MacKay 1998).

    gplvm      none                      Lawrence 2005
    gpdm       none, dynamics            Wang, Fleet and Hertzmann 2006
    ll_gpdm    circle, dynamics          Urtasun et al. 2008
    torus1     torus of one layer        the JGPM of Zhang and Fan 2011
    torus3     torus, scales 0.4, 1, 1.25
    cylinder3  cylinder, the same
    on_torus1, on_torus3, on_cylinder3   the same, points on the surface

The product of the topology's density and the dynamics' (eq. 14) has no constant that
is known: the site ``dynamics`` is a factor. Without dynamics all priors are proper:

    variance ~ LogNormal(0, 1)            features have a mean square of one
    gamma ~ LogNormal(0, 1)               the middle layer has radius one
    beta ~ LogNormal(log 100, 1)
    alpha ~ LogNormal(log medians, 1)     of the dynamics, whose noise is a setting

Cycles of several scales are made of those recorded by eq. 5 (`GaitPose.prepare`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Float
from numpyro import distributions as dist

from ..errors import InputError
from ..gp.kernels import Kernel, rbf
from ..gp.linalg import AnyArray
from ..gp.matrix_normal import GaussianProcess
from ..gp.unnormalised import NoDensity, factor
from ..motion.joining import split
from ..priors.dynamics import GPDynamics, unit_scale
from ..priors.topology import LocallyLinear, log_normaliser
from .gait_cycles import (
    Cycles,
    GaitTraining,
    gait_distances,
    layered,
    learn_cycle_encoding,
    make_cycles,
)
from .gait_surfaces import Kind, beginning, coordinates, on_surface, order_along
from .latent_gp import LatentGP, latent_gp

SCALES = (0.4, 1.0, 1.25)
ALPHA_MEDIAN = (0.1, 1.0, 1.0)
ALPHA_PARTS = ["variance", "gamma", "linear_variance"]

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
        ``torus``, ``cylinder``, ``circle`` or ``none``.
    dynamics
        Whether the latent path of a cycle has Gaussian process dynamics.
    sigma
        How far points stray from what their neighbours make of them; the smaller, the
        more the surface counts and the less the data.
    breadth
        Standard deviation of latent points without a surface.
    dynamics_noise
        Standard deviation of a step of the path about its mean, of paths of unit scale.
    latent_size
        Q without a surface; surfaces have 3.
    on
        Whether points lie on the surface, or are free around it as in the paper.
    personal
        Variance of what is a person's own, of features of mean square one: noise to the
        process that predicts new people's poses (`LatentGP`). It is no part of the density.
    """

    surface: Kind = "torus"
    dynamics: bool = False
    sigma: float = 0.1
    breadth: float = 2.0
    dynamics_noise: float = 0.03
    latent_size: int = 3
    on: bool = False
    personal: float = 0.05

    name: ClassVar[str] = "gait-pose"

    def __post_init__(self) -> None:
        """Refuse points on a surface that is none."""
        if self.on and self.surface not in ("torus", "cylinder"):
            raise InputError(
                "on=True", f"the surface is {self.surface}", "Use a torus or a cylinder"
            )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> "GaitPose":
        """Make the model from its settings as plain values."""
        return cls(**settings)

    def prepare(self, motion: xr.Dataset, *, scales: Sequence[float] = (1.0,)) -> GaitTraining:
        """Make training cycles into arrays.

        Parameters
        ----------
        motion
            Cycles on one skeleton, as `motion.cycles.cycles_of` cuts them.
        scales
            Of the layers, growing: the cycles are repeated at every scale (eq. 5).

        Raises
        ------
        InputError
            If the cycles are not on one skeleton, differ in their number of poses, or
            the scales do not grow.
        """
        scales = tuple(float(scale) for scale in scales)
        every = layered(motion, scales)
        encoding = learn_cycle_encoding(motion)
        names = list(split(motion))
        subject = [str(part["subject"].values[0]) for part in split(motion).values()]
        poses = motion.sizes["frame"] // len(names)
        y = encoding.scaled(every).reshape(len(scales), len(names), poses, -1)
        # Gaits are ordered by what was recorded, the same in all layers.
        distances = gait_distances(encoding.scaled(motion).reshape(len(names), poses, -1))
        order = order_along(self.surface, distances)
        y = y[:, order].reshape(len(scales) * len(names) * poses, -1)
        sizes = [poses] * (len(scales) * len(names))
        surface, topology, start = beginning(
            self.surface, y, poses, len(names), scales, self.latent_size
        )
        normaliser = 0.0
        if surface is not None and not self.on:
            normaliser = log_normaliser(topology, self.sigma, self.breadth)
        return GaitTraining(
            encoding,
            make_cycles(y, start, topology, normaliser, sizes, surface),
            tuple(names[i] for i in order),
            tuple(subject[i] for i in order),
            scales,
        )

    def initial_values(
        self, training: GaitTraining, seed: int, count: int
    ) -> list[dict[str, np.ndarray]]:
        """Give values of the sites to begin the search for the mode from.

        The first is the ideal surface; the others lie around it.
        """
        random = np.random.default_rng(seed)
        start = np.asarray(training.frames.start)
        out = []
        for number in range(count):
            spread = 0.1 if number else 0.0
            values = {name: np.array(value) for name, value in _FIRST.items()}
            if self.on:
                values |= coordinates(training, spread, random)
            else:
                values["x"] = start + spread * random.normal(size=start.shape)
            if self.dynamics:
                values["alpha"] = np.array(ALPHA_MEDIAN)
            out.append(values)
        return out

    def program(self, cycles: Cycles) -> None:
        """Generate the features `cycles.y` (N, D)."""
        hyper = self.hyperparameters()
        x = self._points(cycles)
        points = {"x": x}
        K = self.kernel(hyper).matrix(points, points) + jnp.eye(x.shape[0]) / hyper["beta"]
        outputs = GaussianProcess(K, jnp.ones(cycles.y.shape[1]), None, cycles.missing)
        numpyro.sample("y", outputs, obs=cycles.y)

    def hyperparameters(self) -> dict[str, AnyArray]:
        """Sample what all poses share."""
        priors = _hyperpriors().items()
        return {name: jnp.asarray(numpyro.sample(name, prior)) for name, prior in priors}

    def kernel(self, hyper: Mapping[str, AnyArray]) -> Kernel:
        """Covariance of one feature without the noise."""
        return rbf("x", length_scale=hyper["gamma"] ** -0.5, variance=hyper["variance"])

    def _points(self, cycles: Cycles) -> Float[AnyArray, "n q"]:
        if self.on:
            x = jnp.asarray(numpyro.deterministic("x", on_surface(cycles)))
        elif self.surface == "none":
            free = dist.Normal(0.0, self.breadth).expand(cycles.start.shape).to_event(2)
            x = jnp.asarray(numpyro.sample("x", free))
        else:
            around = LocallyLinear(cycles.topology, self.sigma, self.breadth, cycles.normaliser)
            x = jnp.asarray(numpyro.sample("x", around))
        if self.dynamics:
            medians = jnp.log(jnp.asarray(ALPHA_MEDIAN))
            alpha = numpyro.sample("alpha", dist.LogNormal(medians, 1.0).to_event(1))
            alpha = jnp.append(jnp.asarray(alpha), self.dynamics_noise**-2)
            path = GPDynamics(alpha, cycles.steps, x.shape)
            factor("dynamics", path.log_prob(unit_scale(x, cycles.steps)), PRODUCT)
        return x

    def condition(self, cycles: Cycles, values: Mapping[str, AnyArray]) -> LatentGP:
        """Condition on training cycles and trained site values (one draw)."""
        return self.given_some(cycles, values, None)

    def given_some(
        self, cycles: Cycles, values: Mapping[str, AnyArray], chosen: np.ndarray | None
    ) -> LatentGP:
        """Condition on some of the training cycles, by their numbers."""
        return latent_gp(self.kernel, cycles, values, chosen, self.personal)

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of every site."""
        return {
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

    def coords(self, training: GaitTraining) -> dict[str, list]:
        """Give the labels of every dimension for the training cycles."""
        n, q = training.frames.start.shape
        return {
            "feature": training.encoding.labels,
            "alpha_part": ALPHA_PARTS,
            "frame": list(range(n)),
            "latent": list(range(q)),
            "cycle": [f"{gait} x{scale:g}" for scale in training.scales for gait in training.gaits],
            "gait_name": list(training.gaits),
            "layer": list(training.scales),
        }


_FIRST = {"variance": 1.0, "gamma": 1.0, "beta": 100.0}


def _hyperpriors() -> dict[str, dist.Distribution]:
    return {
        "variance": dist.LogNormal(0.0, 1.0),
        "gamma": dist.LogNormal(0.0, 1.0),
        "beta": dist.LogNormal(jnp.log(100.0), 1.0),
    }


def log_hyperprior(hyper: Mapping[str, AnyArray]) -> Float[AnyArray, ""]:
    """Log density of what all poses share."""
    parts = [prior.log_prob(hyper[name]) for name, prior in _hyperpriors().items()]
    return jnp.sum(jnp.stack([jnp.asarray(part) for part in parts]))


VARIANTS: dict[str, GaitPose] = {
    "gplvm": GaitPose("none"),
    "gpdm": GaitPose("none", dynamics=True),
    "ll_gpdm": GaitPose("circle", dynamics=True),
    "torus1": GaitPose("torus"),
    "torus3": GaitPose("torus"),
    "cylinder3": GaitPose("cylinder"),
    "on_torus1": GaitPose("torus", on=True),
    "on_torus3": GaitPose("torus", on=True),
    "on_cylinder3": GaitPose("cylinder", on=True),
}
LAYERS: dict[str, tuple[float, ...]] = {
    name: SCALES if name.endswith("3") else (1.0,) for name in VARIANTS
}
