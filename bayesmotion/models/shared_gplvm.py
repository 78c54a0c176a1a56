"""Gaussian processes of several views that share one latent path (Deena and Galata 2009).

Every view v of frame t, such as sound and face, is a function of one latent point x_t,
and where there is one of a private latent point of the view's own:

    y_v,d ~ GP(0, k_v) + noise,   k_v = variance_v exp(-1/2 sum_q gamma_v,q (x_q - x'_q)^2)
                                        + linear_v sum_q gamma_v,q x_q x'_q + delta / beta_v
    x        = g(a, W), a back-constraint on one view (`priors.back_constraints`), which
             sees a window around its frame; without one x ~ N(0, I)
    private  of the view with the back-constraint by the same map; of others N(0, I)
    dynamics x_t ~ GP(x_{t-1}) along every clip (`priors.dynamics`), with x about its mean
             and divided by its root mean square

Features are scaled to zero mean and unit spread. Priors:

    variance ~ LogNormal(0, 1),   linear ~ LogNormal(log 0.1, 1)
    gamma_q ~ LogNormal(log(1 / Q), 1)    a coordinate of x is about one in size; one for
                                          all coordinates, or with `relevance` one each
    beta ~ LogNormal(log 5, 1)            signal to noise variance
    alpha ~ LogNormal(log(0.1, 1, 1), 1)  of the dynamics, whose noise is a setting

The dynamics are a factor: with a back-constraint they weigh the map, no constant is known.
Processes go through inducing points at the latent points of some of the frames
(`gp.sparse`); with as many as there are frames everything is exact, with fewer a
view is a factor, a bound (`gp.unnormalised`).

`VARIANTS` has the paper's model, ``sgplvm``, whose A and B are two ways to begin the search
for a new path (`tasks.speech`), and ``sgplvm_window``, whose latent points are all that a
window of sound tells: no bottleneck, and nothing of the map is left to overfit.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Float
from numpyro import distributions as dist

from ..errors import InputError
from ..gp.kernels import Kernel
from ..gp.linalg import AnyArray
from ..gp.sparse import SparseProcess, explain, explain_exactly
from ..gp.unnormalised import NoDensity, factor
from ..priors.back_constraints import BackConstraint
from ..priors.dynamics import kernel as dynamics_kernel
from .shared_processes import SharedGiven, in_unit_scale, unit_scale, view_kernel, view_points
from .shared_views import Look, SharedTraining, Views, prepare_views

ALPHA_MEDIAN = (0.1, 1.0, 1.0)
ALPHA_PARTS = ["variance", "gamma", "linear_variance"]

BOUND = NoDensity(
    "with fewer inducing points than frames it is a bound of the log density, and exp of it no "
    "density",
    "Use method map, or let every frame hold an inducing point (inducing)",
)
PRODUCT = NoDensity(
    "the density of the dynamics multiplies what else is said of the latent path, and the "
    "product's constant, which depends on alpha, is not known",
    "Use a model without dynamics, method map, or fix alpha",
    ("alpha",),
)


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
        The view the back-constraint is on, "" for free latent points.
    constraint
        The map.
    look
        The window that the map sees (`shared_views`).
    relevance
        Whether every latent coordinate has a gamma of its own, for every view: how much the
        view depends on it.
    dynamics
        Whether the latent path has Gaussian process dynamics.
    dynamics_noise
        Standard deviation of a step about its mean, of paths of unit scale.
    inducing
        Frames that hold inducing points.
    exact
        Whether a trained model is conditioned on all its frames, not through inducing points.

    Raises
    ------
    InputError
        If a view that is named is none of the views, or the numbers of private
        coordinates are not one for each of them.
    """

    views: tuple[str, ...] = ("audio", "face")
    latent_size: int = 8
    private: tuple[int, ...] = ()
    back: str = "audio"
    constraint: BackConstraint = field(default_factory=BackConstraint)
    look: Look = field(default_factory=Look)
    relevance: bool = True
    dynamics: bool = True
    dynamics_noise: float = 0.3
    inducing: int = 150
    exact: bool = False

    name: ClassVar[str] = "shared-gplvm"

    def __post_init__(self) -> None:
        """Check the settings once."""
        if self.back and self.back not in self.views:
            raise InputError(repr(self.back), "it is no view", f"Use {', '.join(self.views)}")
        if self.private and len(self.private) != len(self.views):
            raise InputError("private", "it is not one number a view", "Give one for every view")

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> "SharedGPLVM":
        """Make the model from its settings as plain values."""
        parts = {
            "constraint": BackConstraint(**settings["constraint"]),
            "look": Look(**settings["look"]),
        }
        lists = {name: tuple(settings[name]) for name in ("views", "private")}
        return cls(**{**settings, **lists, **parts})

    def prepare(self, data: xr.Dataset, *, every: int = 1) -> SharedTraining:
        """Make every so many frames of clips into arrays; see `shared_views.prepare_views`."""
        return prepare_views(
            data, self.views, back=self.back or None, look=self.look, inducing=self.inducing,
            centres=self.constraint.hidden, every=every,
        )  # fmt: skip

    def program(self, frames: Views) -> None:
        """Generate the scaled views, each (N, D)."""
        x, private = self._latent(frames)
        if self.dynamics:
            factor("dynamics", self._dynamics(x, frames), PRODUCT)
        for name in self.views:
            hyper = self._hyperparameters(name)
            points = view_points(name, hyper, x, private)
            inducing = {"x": points["x"][jnp.asarray(frames.inducing)]}
            process = SparseProcess(
                view_kernel(name, hyper), points, inducing, hyper[f"{name}_beta"],
                frames.y[name].shape,
            )  # fmt: skip
            if len(frames.inducing) == len(frames.clip):
                numpyro.sample(name, process, obs=frames.y[name])
            else:
                factor(name, process.log_prob(frames.y[name]), BOUND)

    def private_sizes(self) -> dict[str, int]:
        """Give the number of every view's own latent coordinates."""
        return dict(zip(self.views, self.private or (0,) * len(self.views), strict=True))

    def mapped(
        self, seen: Float[AnyArray, "n f"], centres: AnyArray, values: Mapping[str, AnyArray]
    ) -> Float[AnyArray, "n q"]:
        """Give what the back-constraint makes of what it sees: x, and beside it the view's own."""
        return self.constraint(seen, values, centres)

    def _latent(self, frames: Views) -> tuple[AnyArray, dict[str, AnyArray]]:
        """Sample the shared path (N, Q) and the private ones."""
        sizes, n, q = self.private_sizes(), len(frames.clip), self.latent_size
        private: dict[str, AnyArray] = {}
        if self.back:
            whole = q + sizes[self.back]
            weights = self.constraint.sample(frames.seen.shape[1], whole)
            both = self.mapped(frames.seen, frames.centres, weights)
            x = numpyro.deterministic("x", both[:, :q])
            if sizes.pop(self.back):
                private[self.back] = both[:, q:]
                numpyro.deterministic(f"{self.back}_private", both[:, q:])
        else:
            x = numpyro.sample("x", dist.Normal().expand([n, q]).to_event(2))
        for name, size in sizes.items():
            if size:
                free = dist.Normal().expand([n, size]).to_event(2)
                private[name] = jnp.asarray(numpyro.sample(f"{name}_private", free))
        return jnp.asarray(x), private

    def _dynamics(self, x: AnyArray, frames: Views) -> AnyArray:
        medians = jnp.log(jnp.asarray(ALPHA_MEDIAN))
        alpha = jnp.asarray(numpyro.sample("alpha", dist.LogNormal(medians, 1.0).to_event(1)))
        x = in_unit_scale(x, *unit_scale(x))
        before = x[frames.steps.before]
        inducing = {"x": before[jnp.asarray(frames.step_inducing)]}
        process = SparseProcess(
            self._step_kernel(alpha), {"x": before}, inducing, self._step_beta(), before.shape
        )
        first = dist.Normal().log_prob(x[frames.steps.first])
        return jnp.sum(first) + process.log_prob(x[frames.steps.after])

    def _step_kernel(self, alpha: AnyArray) -> Kernel:
        return dynamics_kernel(jnp.append(alpha, self.dynamics_noise**-2))

    def _step_beta(self) -> AnyArray:
        return jnp.asarray(self.dynamics_noise**-2)

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

    def condition(self, frames: Views, values: Mapping[str, AnyArray]) -> SharedGiven:
        """Condition on training clips and trained site values (one draw)."""
        x = jnp.asarray(values["x"])
        private = {name: values[key] for name in self.views if (key := f"{name}_private") in values}
        views = {}
        for name in self.views:
            points = view_points(name, values, x, private)
            given = view_kernel(name, values), points
            beta, y = jnp.asarray(values[f"{name}_beta"]), frames.y[name]
            if self.exact:
                views[name] = explain_exactly(*given, beta, y)
            else:
                inducing = {"x": points["x"][jnp.asarray(frames.inducing)]}
                views[name] = explain(*given, inducing, beta, y)
        scaling = unit_scale(x)
        unit = in_unit_scale(x, *scaling)
        steps = None
        if self.dynamics:
            before = unit[frames.steps.before]
            steps = explain(
                self._step_kernel(jnp.asarray(values["alpha"])), {"x": before},
                {"x": before[jnp.asarray(frames.step_inducing)]},
                self._step_beta(), unit[frames.steps.after],
            )  # fmt: skip
        return SharedGiven(dict(values), views, steps, *scaling)

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of every site."""
        found = {"x": ("frame", "latent"), "alpha": ("alpha_part",), **self.constraint.dims()}
        for name in self.views:
            each = (f"{name}_latent",) if self.relevance else ()
            found |= {name: ("frame", f"{name}_feature"), f"{name}_gamma": each}
            found |= {f"{name}_private": ("frame", f"{name}_own_latent")}
            found |= {f"{name}_{part}": () for part in _NUMBERS}
        return found

    def coords(self, training: SharedTraining) -> dict[str, list]:
        """Give the labels of every dimension for the training clips."""
        frames, sizes = training.frames, self.private_sizes()
        own = sizes[self.back] if self.back else 0
        found = {
            "frame": list(range(len(frames.clip))),
            "latent": list(range(self.latent_size)),
            "alpha_part": ALPHA_PARTS,
            "back_input": list(range(frames.seen.shape[1])),
            "back_unit": list(range(self.constraint.hidden)),
            "back_output": list(range(self.latent_size + own)),
        }
        for name, size in sizes.items():
            found[f"{name}_feature"] = list(training.encoding.labels[name])
            found[f"{name}_own_latent"] = list(range(size))
            found[f"{name}_latent"] = list(range(self.latent_size + size))
        return found

    def initial_values(
        self, training: SharedTraining, seed: int, count: int
    ) -> list[dict[str, np.ndarray]]:
        """Give values of the sites to begin the search for the mode from.

        The latent points are the directions of all other views that the back-constraint's
        best tells (`shared_starts`); hidden units differ from start to start.
        """
        from .shared_starts import training_starts  # it needs the model in turn

        return training_starts(self, training, seed, count)


_NUMBERS = ("variance", "linear", "beta")
WINDOW = Look(width=8, taper=4.0, lifter=10.0, components=150)
VARIANTS = {
    "sgplvm": SharedGPLVM(),
    "sgplvm_window": SharedGPLVM(
        latent_size=WINDOW.components, constraint=BackConstraint("identity"), look=WINDOW,
        relevance=False, dynamics=False, inducing=2000, exact=True,
    ),
}  # fmt: skip


def variant(name: str, features: int) -> SharedGPLVM:
    """Give one of `VARIANTS` for a view of so many features.

    A map that is the identity has as many coordinates as its window has principal components:
    no more than numbers.
    """
    model = VARIANTS[name]
    numbers = (2 * model.look.width + 1) * features
    if model.constraint.kind != "identity" or numbers >= model.latent_size:
        return model
    return replace(model, latent_size=numbers, look=replace(model.look, components=numbers))
