"""Gaussian processes of several views that share one latent path (Deena and Galata 2009).

Every view v of frame t, such as sound and face, is a function of one latent point x_t,
and where there is one of a private latent point of the view's own:

    y_v,d ~ GP(0, k_v) + noise,   k_v = variance_v exp(-1/2 sum_q gamma_v,q (x_q - x'_q)^2)
                                        + linear_v sum_q gamma_v,q x_q x'_q + delta / beta_v
    x_t   ~ GP(x_{t-1}) along every clip (`distributions.dynamics`), x_1 ~ N(0, I); N(0, I) without
            dynamics
    private ~ N(0, I)

Features are scaled to zero mean and unit standard deviation. Priors:

    variance ~ LogNormal(0, 1),   linear ~ LogNormal(log 0.1, 1)
    gamma_q ~ LogNormal(log(1 / Q), 1)    a coordinate of x is about one in size; one for
                                          all coordinates, or with `relevance` one each
    beta ~ LogNormal(log 5, 1)            signal to noise variance
    alpha ~ LogNormal(log(0.1, 1, l), 1)  of the dynamics: variance, inverse squared length and
                                          linear variance; the noise and l are settings

This is a density of everything, and the default. The paper's model, `published`, differs:

- A back-constraint on one view makes x a function of that view, x = g(a, W), beside it the
  view's private points. The view is then explained by points made of itself: that term is no
  density, but a factor ``<view>_given_itself``.
- Dynamics are then no prior of x, but a factor ``dynamics_of_map`` that weighs the map, of x
  about its mean and divided by its root mean square; no constant is known.

Where training has more frames than `Inducing.above`, processes go through inducing points at
some of the frames, and factors ``<view>_bound``, ``dynamics_bound`` bound their densities
(`gp.sparse`). Factors are for searching a mode, not for sampling.

New clips have paths of their own, x ~ GP(x_{t-1}) given the training steps, and are told by the
views' processes given the training frames; where the map is the identity their points are
their inputs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Array, Float
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ...distributions.dynamics import GPDynamics
from ...distributions.dynamics import kernel as dynamics_kernel
from ...errors import InputError
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import GaussianProcess, complete, log_density
from ...gp.sparse import SparsePosterior, collapsed_bound
from ...gp.unnormalised import NoDensity, factor
from ...model import About, SBCCase, Values
from ...prediction import GPPredictive
from ...sensing.face.views import read_views
from . import example, identified, initial_values, prediction, sbc
from .back_constraint import BackConstraint, Identity
from .data import SharedData, Views, prepare_views
from .processes import (
    ScaledPath,
    StepwisePath,
    Trained,
    moments,
    pattern_of_columns,
    unit_scale,
    view_covariance,
    view_kernel,
    view_points,
)

ALPHA_PARTS = ["variance", "gamma", "linear_variance"]
NUMBERS = ("variance", "linear", "beta")

BOUND = NoDensity(
    "with inducing points it is a bound of the log density, and exp of it no density",
    "Use method map, or exact processes (inducing=None)",
)
MAP_ONLY = NoDensity(
    "the back-constraint makes the latent points of the very data they are to explain, and "
    "exp of that is no density",
    "Use method map, or free latent points (back=None)",
)


@dataclass(frozen=True)
class Dynamics:
    """Gaussian process dynamics of the latent path.

    Parameters
    ----------
    noise_sd
        Standard deviation of a step about its mean.
    linear
        Prior median of the linear variance: paths are stable below 1 / Q.

    Raises
    ------
    InputError
        If one is not positive.
    """

    noise_sd: float = 0.3
    linear: float = 0.1

    def __post_init__(self) -> None:
        """Check the settings once."""
        if not min(self.noise_sd, self.linear) > 0:
            raise InputError("dynamics", "a number is not positive", "Use positive ones")

    @property
    def medians(self) -> tuple[float, float, float]:
        """Prior medians of alpha."""
        return 0.1, 1.0, self.linear

    @property
    def beta(self) -> Float[Array, ""]:
        """Precision of a step's noise."""
        return jnp.asarray(self.noise_sd**-2)

    def hyperparameters(self, alpha: AnyArray) -> Float[Array, " a"]:
        """Return alpha with the precision of the noise, as `distributions.dynamics` has them."""
        return jnp.append(jnp.asarray(alpha), self.beta)


@dataclass(frozen=True)
class Inducing:
    """Inducing points, of every process as many.

    Parameters
    ----------
    points
        M.
    above
        They are used where training has more frames than this, else densities are exact: at
        600 frames a value and gradient takes about a tenth of a second, at 2,000 ten times as
        long (`docs/speech.md`).

    Raises
    ------
    InputError
        If there are none.
    """

    points: int = 150
    above: int = 600

    def __post_init__(self) -> None:
        """Check the settings once."""
        if self.points < 1:
            raise InputError("inducing", "there are no points", "Use some, or None for all frames")


@dataclass(frozen=True)
class SharedGPLVM:
    """The shared latent model with its settings; see the module for the equations.

    Parameters
    ----------
    views
        Names of the views.
    latent_size
        Q of the shared latent points.
    private
        For every view how many latent coordinates it has for itself; none where empty.
    back
        The back-constraint; None for free latent points.
    relevance
        Whether every latent coordinate has a gamma of its own, for every view: how much the
        view depends on it.
    dynamics
        Of the latent path; None without.
    inducing
        How long training clips are approximated; None for never.
    every
        Only every so many frames of a clip are explained. Windows of a back-constraint see all
        of them, and where all latent points are made by it predictions rest on all.

    Raises
    ------
    InputError
        If a view that is named is none of the views, or the numbers of private
        coordinates are not one for each of them.
    """

    views: tuple[str, ...] = ("audio", "face")
    latent_size: int = 8
    private: tuple[int, ...] = ()
    back: BackConstraint | None = None
    relevance: bool = True
    dynamics: Dynamics | None = field(default_factory=Dynamics)
    inducing: Inducing | None = field(default_factory=Inducing)
    every: int = 1

    name: ClassVar[str] = "shared_gplvm"
    about: ClassVar[About] = About(
        "Deena and Galata 2009", "views of the same frames, such as speech and a face"
    )

    def __post_init__(self) -> None:
        """Check the settings once."""
        if self.back is not None and self.back.view not in self.views:
            raise InputError(repr(self.back.view), "it is no view", f"Use {', '.join(self.views)}")
        if self.private and len(self.private) != len(self.views):
            raise InputError("private", "it is not one number a view", "Use one for every view")
        if self.every < 1:
            raise InputError("every", f"it is {self.every}", "Use 1 or more")

    @classmethod
    def example(cls, seed: int = 0) -> tuple["SharedGPLVM", xr.Dataset]:
        """Return a small model and clips of two views of a point that goes round."""
        return cls(latent_size=2, relevance=False), example.talk(seed)

    read = staticmethod(read_views)

    @classmethod
    def settings_for(cls, recordings: xr.Dataset) -> dict[str, Any]:
        """Return no settings: none follow from recordings."""
        return {}

    def prepare(self, recordings: xr.Dataset, trained: SharedData | None = None) -> SharedData:
        """Make clips into arrays; see `data.prepare_views`."""
        return prepare_views(self, recordings, trained)

    def program(self, frames: Views, trained: Trained | None = None) -> None:
        """Generate the scaled views, each (N, D); given a trained model those of new clips."""
        if trained is not None:
            self._new_program(frames, trained)
            return
        x, private = self._latent(frames)
        for name in self.views:
            hyper = self._hyperparameters(name)
            self._explain(name, frames, hyper, view_points(name, hyper, x, private))

    def private_sizes(self) -> dict[str, int]:
        """Return the number of every view's own latent coordinates."""
        return dict(zip(self.views, self.private or (0,) * len(self.views), strict=True))

    def mapped(
        self, inputs: AnyArray, centres: AnyArray, values: Mapping[str, AnyArray]
    ) -> tuple[AnyArray, dict[str, AnyArray]]:
        """Return what the back-constraint makes of its inputs: x, and its view's own points."""
        assert self.back is not None
        both = self.back(inputs, values, centres)
        own = both[:, self.latent_size :]
        return both[:, : self.latent_size], {self.back.view: own} if own.shape[1] else {}

    def _latent(self, frames: Views) -> tuple[AnyArray, dict[str, AnyArray]]:
        """Sample the shared path (N, Q) and the private ones of the training frames."""
        n, q, private = len(frames.kept), self.latent_size, {}
        alpha = None
        if self.dynamics is not None:
            prior = dist.LogNormal(jnp.log(jnp.asarray(self.dynamics.medians)), 1.0).to_event(1)
            alpha = self.dynamics.hyperparameters(jnp.asarray(numpyro.sample("alpha", prior)))
        if self.back is not None:
            size = q + self.private_sizes()[self.back.view]
            inputs = frames.inputs[frames.kept]
            weights = self.back.sample(inputs.shape[1], size)
            x, private = self.mapped(inputs, frames.centres, weights)
            numpyro.deterministic("x", x)
            for name, own in private.items():
                numpyro.deterministic(f"{name}_private", own)
            if alpha is not None:
                mean, scale = unit_scale(x)
                unit = (x - mean) / scale
                self._weigh_steps("dynamics_of_map", alpha, unit, frames, MAP_ONLY)
        elif alpha is None:
            x = numpyro.sample("x", dist.Normal().expand([n, q]).to_event(2))
        elif frames.exact:
            x = numpyro.sample("x", GPDynamics(alpha, frames.steps, (n, q)))
        else:
            flat = dist.ImproperUniform(constraints.real_matrix, (), (n, q))
            x = jnp.asarray(numpyro.sample("x", flat))
            self._weigh_steps("dynamics_bound", alpha, x, frames, BOUND)
        return jnp.asarray(x), {**private, **self._free_private(n)}

    def _free_private(self, n: int) -> dict[str, AnyArray]:
        """Sample the private points that no back-constraint makes."""
        mapped = None if self.back is None else self.back.view
        return {
            name: jnp.asarray(
                numpyro.sample(f"{name}_private", dist.Normal().expand([n, size]).to_event(2))
            )
            for name, size in self.private_sizes().items()
            if size and name != mapped
        }

    def _weigh_steps(
        self, name: str, alpha: AnyArray, x: AnyArray, frames: Views, mark: NoDensity
    ) -> None:
        """Add the log density of a path's steps, or its bound, as a factor."""
        if frames.exact:
            factor(name, GPDynamics(alpha, frames.steps, x.shape).log_prob(x), mark)
            return
        before, after = x[frames.steps.before], x[frames.steps.after]
        inducing = {"x": before[jnp.asarray(frames.step_inducing)]}
        bound = collapsed_bound(
            dynamics_kernel(alpha), {"x": before}, inducing, alpha[-1], after,
            complete(*after.shape),
        )  # fmt: skip
        first = dist.Normal().log_prob(x[frames.steps.first])
        factor(name, jnp.sum(first) + jnp.sum(bound), mark)

    def _explain(
        self, name: str, frames: Views, hyper: Mapping[str, AnyArray], points: dict[str, AnyArray]
    ) -> None:
        """Sample a view of the training frames, or weigh it where that is no density."""
        y, missing = frames.kept_of(name)
        if not frames.exact:
            inducing = {"x": points["x"][jnp.asarray(frames.inducing)]}
            bound = collapsed_bound(
                view_kernel(name, hyper), points, inducing, hyper[f"{name}_beta"], y, missing
            )
            factor(f"{name}_bound", jnp.sum(bound), BOUND)
            return
        K, ones = view_covariance(name, hyper, points), jnp.ones(y.shape[1])
        if self.back is not None and self.back.view == name:
            factor(f"{name}_given_itself", log_density(y, K, ones, missing), MAP_ONLY)
        else:
            numpyro.sample(name, GaussianProcess(K, ones, missing=missing), obs=y)

    def _hyperparameters(self, name: str) -> dict[str, AnyArray]:
        size = self.latent_size + self.private_sizes()[name]
        near = dist.LogNormal(-jnp.log(size), 1.0)
        priors = {
            "variance": dist.LogNormal(0.0, 1.0),
            "linear": dist.LogNormal(jnp.log(0.1), 1.0),
            "gamma": near.expand([size]).to_event(1) if self.relevance else near,
            "beta": dist.LogNormal(jnp.log(5.0), 1.0),
        }
        named = {f"{name}_{part}": prior for part, prior in priors.items()}
        return {site: jnp.asarray(numpyro.sample(site, prior)) for site, prior in named.items()}

    def _new_program(self, frames: Views, trained: Trained) -> None:
        n = len(frames.kept)
        x, private = self._new_latent(frames, trained)
        private = {**private, **self._free_private(n)}
        for name in self.views:
            points = view_points(name, trained.values, x, private)
            y, missing = frames.y[name], frames.missing[name]
            beta, posterior = trained.values[f"{name}_beta"], trained.views[name]
            if isinstance(posterior, SparsePosterior):
                mean, variance = posterior(points)
                sd = jnp.sqrt(variance[pattern_of_columns(missing)].T + 1.0 / beta)
                seen = ~jnp.isnan(y)
                each = dist.Normal(mean, sd).mask(seen).to_event(2)
                numpyro.sample(name, each, obs=jnp.where(seen, y, 0.0))
                continue
            mean, covariance = moments(posterior, points)
            K = covariance + jnp.eye(n) / beta
            numpyro.sample(name, GaussianProcess(K, jnp.ones(y.shape[1]), mean, missing), obs=y)

    def _new_latent(self, frames: Views, trained: Trained) -> tuple[AnyArray, dict[str, AnyArray]]:
        """Sample the path of new clips; what is made of a view's inputs is not sampled."""
        private: dict[str, AnyArray] = {}
        if self.back is not None:
            x, private = self.mapped(frames.inputs, trained.centres, trained.values)
            if isinstance(self.back.map, Identity):
                return jnp.asarray(numpyro.deterministic("x", x)), private
        return jnp.asarray(numpyro.sample("x", self._path(frames, trained))), private

    def _path(self, frames: Views, trained: Trained) -> dist.Distribution:
        shape = (len(frames.kept), self.latent_size)
        if self.dynamics is None or trained.steps is None:
            return dist.Normal().expand(shape).to_event(2)
        if isinstance(trained.steps, SparsePosterior):
            path = StepwisePath(trained.steps, frames.steps, shape)
        else:
            alpha = self.dynamics.hyperparameters(trained.values["alpha"])
            path = GPDynamics(alpha, frames.steps, shape, trained.steps)
        return path if self.back is None else ScaledPath(path, trained.mean, trained.scale)

    def initial_values(
        self, data: SharedData, seed: int, count: int, trained: Trained | None = None
    ) -> list[dict[str, np.ndarray]]:
        """Return values of the sites to begin the search for the mode from.

        See `initial_values` for those of training. Those of new clips are first what the
        back-constraint makes of them (start A of the paper), then the likeliest path through
        training points (start B).
        """
        if trained is None:
            return initial_values.of_training(self, data, seed, count)
        return initial_values.of_new_clips(self, data, seed, count, trained)

    def path_start(self, new: SharedData, trained: Trained, start: str) -> dict[str, np.ndarray]:
        """Return where the paper begins the search for the path of new clips, ``A`` or ``B``.

        Raises
        ------
        InputError
            If there is no back-constraint: it makes the path that the search begins at.
        """
        if self.back is None:
            raise InputError(
                "start", "the model has no back-constraint to start from", "Leave it out"
            )
        starts = self.initial_values(new, 0, 2, trained)
        return starts[min("AB".index(start), len(starts) - 1)]

    def condition(self, frames: Views, values: Mapping[str, AnyArray]) -> Trained:
        """Condition on training clips and trained site values (one draw)."""
        return prediction.condition(self, frames, values)

    def predict(
        self, trained: Trained, frames: Views, values: Mapping[str, AnyArray]
    ) -> dict[str, GPPredictive]:
        """Predict all views of new clips along their path, given what is seen of them."""
        return prediction.predict(self, trained, frames, values)

    def identified(self, frames: Views, values: Mapping[str, AnyArray]) -> Values:
        """Return hyperparameters, and distances of frames in every view; see `identified`."""
        return identified.quantities(self, frames, values)

    def pointwise(self, frames: Views, values: Mapping[str, AnyArray]) -> Float[Array, " n"]:
        """Return ``log p(y_t | y_-t, x, theta)`` of every frame, all views together.

        A view with the back-constraint is not predicted, and is left out.

        Raises
        ------
        InputError
            If processes go through inducing points: a bound has no such conditional.
        """
        return identified.left_out(self, frames, values)

    def points(self, data: SharedData) -> dict[str, tuple[str, np.ndarray]]:
        """Return clip and number of every frame."""
        return {
            "clip": ("point", np.array(data.clip_names)),
            "frame": ("point", np.asarray(data.frames.kept)),
        }

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the dimensions of every site and identified quantity."""
        found = {"x": ("frame", "latent"), "alpha": ("alpha_part",)}
        if self.back is not None:
            found |= self.back.dims()
        for name in self.views:
            each = (f"{name}_latent",) if self.relevance else ()
            found |= {name: ("frame", f"{name}_feature"), f"{name}_gamma": each}
            found |= {f"{name}_private": ("frame", f"{name}_own_latent")}
            found |= {f"{name}_{part}": () for part in NUMBERS}
        return found | identified.dims(self)

    def coords(self, data: SharedData) -> dict[str, list]:
        """Return the labels of every dimension."""
        frames, sizes = data.frames, self.private_sizes()
        own = 0 if self.back is None else sizes[self.back.view]
        found = {
            "frame": list(range(len(frames.kept))),
            "latent": list(range(self.latent_size)),
            "alpha_part": ALPHA_PARTS,
            "back_input": list(range(frames.inputs.shape[1])),
            "back_unit": list(range(0 if self.back is None else self.back.map.hidden)),
            "back_output": list(range(self.latent_size + own)),
        }
        for name, size in sizes.items():
            found[f"{name}_feature"] = list(data.encoding.labels[name])
            found[f"{name}_own_latent"] = list(range(size))
            found[f"{name}_latent"] = list(range(self.latent_size + size))
        return found | identified.coords(data.frames)

    @property
    def rotations(self) -> tuple[str, ...]:
        """Names of free latent points that count up to a rotation: those of equal relevance."""
        if self.relevance or self.back is not None or any(self.private_sizes().values()):
            return ()
        return ("x",)

    def sbc_case(self) -> tuple[SBCCase, Views]:
        """Return two clips of a few frames and features; see `sbc`.

        Raises
        ------
        InputError
            If there is a back-constraint: no data can be drawn.
        """
        return sbc.case(self)
