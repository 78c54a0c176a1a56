"""Multivariate relevance vector machine (Tipping 2001; Thayananthan et al. 2006).

Outputs are sums of basis functions, a constant and one Gaussian at every training point,
whose weights have precisions that all outputs share; each output has its noise:

    y_nm = sum_b Phi_nb W_bm + noise_m
    Phi_n0 = 1,    Phi_nb = exp(-|x_n - x_b|^2 / (2 length_scale^2))
    W_bm ~ N(0, 1 / alpha_b),    noise_m ~ N(0, 1 / beta_m)

Priors, for outputs scaled to about unit variance:

    alpha_b ~ LogNormal(0, 4)           from a basis that does all to one that does nothing
    beta_m ~ LogNormal(log 100, 2)

`RelevanceVectors.collapsed` has the weights integrated out: y_m ~ N(0, C_m) with
C_m = I / beta_m + Phi diag(1 / alpha) Phi^T. The paper's estimate maximises that density
over alpha and beta with flat priors on their logarithms, where most alpha are infinite:
`relevance_fast`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Float, PRNGKeyArray
from numpyro import distributions as dist

from ..errors import InputError
from ..gp.linalg import AnyArray, cholesky
from .clusters import squared_distances


class Design(NamedTuple):
    """Basis functions Phi (N, B) at the training points, and outputs y (N, M)."""

    phi: Float[AnyArray, "n b"]
    y: Float[AnyArray, "n m"]


def basis_functions(
    x: Float[np.ndarray, "n f"], centres: Float[np.ndarray, "b f"], length_scale: float
) -> Float[np.ndarray, "n one_b"]:
    """Give the constant and the Gaussians around `centres` at points x: (N, 1 + B)."""
    gaussians = np.exp(-0.5 / length_scale**2 * squared_distances(x, centres))
    return np.column_stack([np.ones(len(x)), gaussians])


@dataclass(frozen=True)
class RelevanceTraining:
    """Training points as the model sees them.

    design
        The arrays for the program.
    outputs
        Names of the outputs.
    """

    design: Design
    outputs: tuple[str, ...]

    @property
    def data(self) -> tuple[Design]:
        """The arguments of the model's program."""
        return (self.design,)

    def observed(self) -> xr.Dataset:
        """What the model explains: ``y`` (frame, output)."""
        return xr.Dataset(
            {"y": (("frame", "output"), np.asarray(self.design.y))},
            {"output": list(self.outputs)},
        )

    def constants(self) -> xr.Dataset:
        """The basis functions at the training points."""
        return xr.Dataset({"phi": (("frame", "basis"), np.asarray(self.design.phi))})


@dataclass(frozen=True)
class RelevanceVectors:
    """The machine with its settings; see the module for the equations.

    Parameters
    ----------
    length_scale
        Of the Gaussians, in the units of x.

    Raises
    ------
    InputError
        If it is not positive.
    """

    length_scale: float = 1.0

    name: ClassVar[str] = "relevance_vector"

    def __post_init__(self) -> None:
        """Check the setting once."""
        if not self.length_scale > 0:
            raise InputError("length_scale", f"it is {self.length_scale}", "Give a positive number")

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> "RelevanceVectors":
        """Make the model from its settings as plain values."""
        return cls(**settings)

    def prepare(self, data: xr.Dataset) -> RelevanceTraining:
        """Make a data set with ``x`` (frame, feature) and ``y`` (frame, output) into arrays.

        Raises
        ------
        InputError
            If it has no such variables.
        """
        wanted = {"x": ("frame", "feature"), "y": ("frame", "output")}
        for name, dims in wanted.items():
            if name not in data or data[name].dims != dims:
                raise InputError("points", f"there is no {name} {dims}", "Name the variables x, y")
        x, y = (np.asarray(data[name].values, dtype=float) for name in wanted)
        design = Design(basis_functions(x, x, self.length_scale), y)
        return RelevanceTraining(design, tuple(map(str, data["output"].values)))

    def program(self, design: Design) -> None:
        """Generate the outputs (N, M)."""
        alpha, beta = self._precisions(design)
        shape = [design.phi.shape[1], design.y.shape[1]]
        weights = dist.Normal(0.0, alpha[:, None] ** -0.5).expand(shape).to_event(2)
        W = numpyro.sample("weight", weights)
        mean = jnp.asarray(design.phi) @ W
        numpyro.sample("y", dist.Normal(mean, beta**-0.5), obs=design.y)

    def collapsed(self, design: Design) -> None:
        """Generate the outputs with the weights integrated out."""
        alpha, beta = self._precisions(design)
        phi = jnp.asarray(design.phi)
        shared = (phi / alpha) @ phi.T
        eye = jnp.eye(len(phi))
        factors = jax.vmap(lambda one: cholesky(shared + eye / one))(beta)
        zero = jnp.zeros(len(phi))
        numpyro.sample(
            "y",
            _Columns(dist.MultivariateNormal(zero, scale_tril=factors)),
            obs=design.y,
        )

    def complete_draw(
        self, key: PRNGKeyArray, frames: Design, values: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Draw the weights given the precisions; give all of them."""
        phi, y = jnp.asarray(frames.phi), jnp.asarray(frames.y)
        alpha, beta = jnp.asarray(values["alpha"]), jnp.asarray(values["beta"])
        keys = jax.random.split(key, y.shape[1])

        def column(key, y, beta):
            # In units of the prior's spread, so that the matrix is well scaled.
            scaled = phi / jnp.sqrt(alpha)
            L = cholesky(jnp.eye(len(alpha)) + beta * scaled.T @ scaled)
            solve = jax.scipy.linalg.solve_triangular
            mean = solve(L.T, solve(L, beta * scaled.T @ y, lower=True))
            noise = solve(L.T, jax.random.normal(key, alpha.shape))
            return (mean + noise) / jnp.sqrt(alpha)

        W = jax.vmap(column, in_axes=(0, 1, 0), out_axes=1)(keys, y, beta)
        return {**values, "weight": W}

    def _precisions(self, design: Design) -> tuple[AnyArray, AnyArray]:
        basis, outputs = design.phi.shape[1], design.y.shape[1]
        alpha = dist.LogNormal(0.0, 4.0).expand([basis]).to_event(1)
        beta = dist.LogNormal(jnp.log(100.0), 2.0).expand([outputs]).to_event(1)
        return jnp.asarray(numpyro.sample("alpha", alpha)), jnp.asarray(
            numpyro.sample("beta", beta)
        )

    def initial_values(
        self, training: RelevanceTraining, seed: int, count: int
    ) -> list[dict[str, np.ndarray]]:
        """Give starts: precisions near one, the weights of a ridge regression."""
        design = training.design
        phi, y = np.asarray(design.phi), np.asarray(design.y)
        random = np.random.default_rng(seed)
        found = []
        for _ in range(count):
            alpha = np.exp(0.5 * random.standard_normal(phi.shape[1]))
            beta = np.exp(np.log(30.0) + 0.5 * random.standard_normal(y.shape[1]))
            ridge = phi.T @ phi + np.diag(alpha) / beta.mean()
            weight = np.linalg.solve(ridge, phi.T @ y)
            found.append({"alpha": alpha, "beta": beta, "weight": weight})
        return found

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of every site."""
        return {
            "y": ("frame", "output"),
            "alpha": ("basis",),
            "beta": ("output",),
            "weight": ("basis", "output"),
        }

    def coords(self, training: RelevanceTraining) -> dict[str, list]:
        """Give the labels of every dimension."""
        frames, basis = training.design.phi.shape
        return {
            "frame": list(range(frames)),
            "basis": ["constant", *range(basis - 1)],
            "output": list(training.outputs),
        }


class _Columns(dist.Distribution):
    """Independent columns (N, M) with a batch of M distributions over their N entries."""

    pytree_data_fields = ("columns",)

    def __init__(self, columns: dist.Distribution) -> None:
        self.columns = columns
        (outputs,), (frames,) = columns.batch_shape, columns.event_shape
        super().__init__(batch_shape=(), event_shape=(frames, outputs))

    @property
    def support(self) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        return dist.constraints.real_matrix

    def sample(self, key, sample_shape=()):
        return jnp.asarray(self.columns.sample(key, sample_shape)).swapaxes(-1, -2)

    def log_prob_parts(self, value):
        return jnp.asarray(self.columns.log_prob(value.swapaxes(-1, -2)))

    def log_prob(self, value):
        return self.log_prob_parts(value).sum(axis=-1)
