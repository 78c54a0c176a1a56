"""Back-constraints: latent points as a function of what is observed of one view.

A Gaussian process takes near latent points to near observations, not the other way
round. A back-constraint does (Lawrence and Quinonero-Candela 2006): x = g(a, W), with
the weights W in place of the points as unknowns. With a (N, F) what a context window tells
(`window`), scaled to unit size,

    identity x = a                          no weights: Q = F
    linear   x = a A
    mlp      x = a A + tanh(a U + b) V      H hidden units, here beside a linear part
    rbf      x = a A + Phi V                Phi_nh = exp(-|a_n - c_h|^2 / (2 F length^2)),
                                            centres c among the a

    A_fq ~ N(0, 1 / F),    U_fh ~ N(0, 1 / F),    b_h ~ N(0, 1),    V_hq ~ N(0, sd^2 / H)

so that a latent coordinate is about one in size, whatever F and H. The linear part is
there so that the map begins as a projection of the data, and far from all of them goes
on as one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Array, Float
from numpyro import distributions as dist

from ...errors import InputError
from ...gp.linalg import AnyArray
from .window import ContextWindow

PREFIX = "back_"
Weights = Mapping[str, AnyArray]


@dataclass(frozen=True)
class Identity:
    """The latent points are what is seen: there is nothing to learn of them."""

    @property
    def hidden(self) -> int:
        """No hidden units."""
        return 0


@dataclass(frozen=True)
class Linear:
    """A linear map."""

    @property
    def hidden(self) -> int:
        """No hidden units."""
        return 0


@dataclass(frozen=True)
class MLP:
    """A linear map plus a layer of hidden units.

    Parameters
    ----------
    hidden
        Number of hidden units.
    sd
        Prior standard deviation of their part.
    """

    hidden: int = 32
    sd: float = 1.0


@dataclass(frozen=True)
class RBF:
    """A linear map plus Gaussians about training frames.

    Parameters
    ----------
    hidden
        Number of these frames.
    length
        Of the Gaussians, in root mean square of a coordinate of what is seen.
    sd
        Prior standard deviation of their part.
    """

    hidden: int = 32
    length: float = 1.0
    sd: float = 1.0


@dataclass(frozen=True)
class BackConstraint:
    """A map from one view to latent points.

    Parameters
    ----------
    view
        The view it is a function of.
    map
        `Identity`, `Linear`, `MLP` or `RBF`.
    window
        What it sees of the view.

    Raises
    ------
    InputError
        If a number is not positive.
    """

    view: str = "audio"
    map: Identity | Linear | MLP | RBF = field(default_factory=MLP)
    window: ContextWindow = field(default_factory=ContextWindow)

    def __post_init__(self) -> None:
        """Check the settings once."""
        if isinstance(self.map, MLP | RBF) and not min(self.map.hidden, self.map.sd) > 0:
            raise InputError("back-constraint", "a number is not positive", "Use positive ones")
        if isinstance(self.map, RBF) and not self.map.length > 0:
            raise InputError("back-constraint", "a length is not positive", "Use a positive one")

    def priors(self, inputs: int, size: int) -> dict[str, dist.Distribution]:
        """Return the priors of the weights of a map from F = inputs to Q = size numbers.

        Raises
        ------
        InputError
            If the identity is to change their number.
        """
        if isinstance(self.map, Identity):
            if inputs != size:
                raise InputError(
                    "back-constraint",
                    f"it takes {inputs} numbers to {size}",
                    f"Use {inputs} latent coordinates for the map identity",
                )
            return {}
        found = {"linear": dist.Normal(0.0, inputs**-0.5).expand([inputs, size]).to_event(2)}
        if isinstance(self.map, MLP | RBF):
            out = dist.Normal(0.0, self.map.sd * self.map.hidden**-0.5)
            found["out"] = out.expand([self.map.hidden, size]).to_event(2)
        if isinstance(self.map, MLP):
            hidden = dist.Normal(0.0, inputs**-0.5).expand([inputs, self.map.hidden])
            found["hidden"] = hidden.to_event(2)
            found["bias"] = dist.Normal().expand([self.map.hidden]).to_event(1)
        return {PREFIX + name: prior for name, prior in found.items()}

    def sample(self, inputs: int, size: int) -> dict[str, AnyArray]:
        """Sample the weights."""
        priors = self.priors(inputs, size).items()
        return {name: jnp.asarray(numpyro.sample(name, prior)) for name, prior in priors}

    def __call__(
        self, a: Float[AnyArray, "n f"], weights: Weights, centres: Float[AnyArray, "h f"]
    ) -> Float[Array, "n q"]:
        """Return the latent points of what is seen."""
        if isinstance(self.map, Identity):
            return jnp.asarray(a)
        x = jnp.asarray(a) @ weights[PREFIX + "linear"]
        if isinstance(self.map, Linear):
            return x
        return x + _features(self.map, a, weights, centres) @ weights[PREFIX + "out"]

    def weights_near(
        self,
        a: Float[np.ndarray, "n f"],
        x: Float[np.ndarray, "n q"],
        centres: Float[np.ndarray, "h f"],
        random: np.random.Generator,
    ) -> dict[str, np.ndarray]:
        """Return weights whose map is near x: the most likely ones under their priors.

        The noise is a tenth of the standard deviation of x; hidden units are drawn from their
        prior.
        """
        if isinstance(self.map, Identity):
            return {}
        inputs, size = a.shape[1], x.shape[1]
        weights: dict[str, np.ndarray] = {}
        design, precision = [a], [np.full(inputs, float(inputs))]
        if isinstance(self.map, MLP):
            hidden = self.map.hidden
            weights[PREFIX + "hidden"] = random.normal(size=(inputs, hidden)) / inputs**0.5
            weights[PREFIX + "bias"] = random.normal(size=hidden)
        if isinstance(self.map, MLP | RBF):
            design.append(np.asarray(_features(self.map, a, weights, centres)))
            precision.append(np.full(self.map.hidden, self.map.hidden / self.map.sd**2))
        phi, ridge = np.concatenate(design, axis=1), np.concatenate(precision)
        noise = 0.01 * np.mean(x**2)
        found = np.linalg.solve(phi.T @ phi + noise * np.diag(ridge), phi.T @ x)
        weights[PREFIX + "linear"] = found[:inputs]
        if len(found) > inputs:
            weights[PREFIX + "out"] = found[inputs:].reshape(-1, size)
        return weights

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the dimensions of the weights."""
        every = {
            "linear": ("back_input", "back_output"),
            "out": ("back_unit", "back_output"),
            "hidden": ("back_input", "back_unit"),
            "bias": ("back_unit",),
        }
        return {PREFIX + name: dims for name, dims in every.items()}


def _features(
    kind: MLP | RBF, a: AnyArray, weights: Weights, centres: AnyArray
) -> Float[Array, "n h"]:
    a, centres = jnp.asarray(a), jnp.asarray(centres)
    if isinstance(kind, MLP):
        return jnp.tanh(a @ weights[PREFIX + "hidden"] + weights[PREFIX + "bias"])
    squares = jnp.sum(a**2, axis=1)[:, None] + jnp.sum(centres**2, axis=1)
    apart = jnp.maximum(squares - 2.0 * a @ centres.T, 0.0)
    return jnp.exp(-0.5 * apart / (a.shape[1] * kind.length**2))
