"""Back-constraints: latent points as a function of what is observed.

A Gaussian process takes near latent points to near observations, not the other way
round. A back-constraint does (Lawrence and Quinonero-Candela 2006): x = g(a, W), with
the weights W in place of the points as unknowns. With a (N, F), scaled to unit spread,

    identity x = a                          no weights: Q = F
    linear   x = a A
    mlp      x = a A + tanh(a U + b) V      H hidden units, here beside a linear part
    rbf      x = a A + Phi V                Phi_nh = exp(-|a_n - c_h|^2 / (2 F length^2)),
                                            centres c among the a

    A_fq ~ N(0, 1 / F),    U_fh ~ N(0, 1 / F),    b_h ~ N(0, 1),    V_hq ~ N(0, spread^2 / H)

so that a latent coordinate is about one in size, whatever F and H. The linear part is
there so that the map begins as a projection of the data, and far from all of them goes
on as one.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Array, Float
from numpyro import distributions as dist

from ..errors import InputError
from ..gp.linalg import AnyArray

Kind = Literal["identity", "linear", "mlp", "rbf"]
KINDS = get_args(Kind)
PREFIX = "back_"


@dataclass(frozen=True)
class BackConstraint:
    """A map from observations to latent points, with its settings.

    Parameters
    ----------
    kind
        ``identity``, ``linear``, ``mlp`` or ``rbf``.
    hidden
        H: hidden units, or centres.
    length
        Of the Gaussians of rbf, in root mean square of a coordinate of a.
    spread
        How large the curved part is beside the linear one.

    Raises
    ------
    InputError
        If the kind is not known or a number is not positive.
    """

    kind: Kind = "mlp"
    hidden: int = 32
    length: float = 1.0
    spread: float = 1.0

    def __post_init__(self) -> None:
        """Check the settings once."""
        if self.kind not in KINDS:
            raise InputError(repr(self.kind), "there is no such map", f"Use {', '.join(KINDS)}")
        if self.hidden < 1 or not min(self.length, self.spread) > 0:
            raise InputError("back-constraint", "a number is not positive", "Give positive ones")

    def priors(self, inputs: int, size: int) -> dict[str, dist.Distribution]:
        """Give the priors of the weights of a map from F = inputs to Q = size numbers."""
        if self.kind == "identity":
            if inputs != size:
                raise InputError(
                    "back-constraint",
                    f"it takes {inputs} numbers to {size}",
                    f"Use {inputs} latent coordinates for the map identity",
                )
            return {}
        found = {"linear": dist.Normal(0.0, inputs**-0.5).expand([inputs, size]).to_event(2)}
        if self.kind != "linear":
            out = dist.Normal(0.0, self.spread * self.hidden**-0.5)
            found["out"] = out.expand([self.hidden, size]).to_event(2)
        if self.kind == "mlp":
            hidden = dist.Normal(0.0, inputs**-0.5).expand([inputs, self.hidden])
            found["hidden"] = hidden.to_event(2)
            found["bias"] = dist.Normal().expand([self.hidden]).to_event(1)
        return {PREFIX + name: prior for name, prior in found.items()}

    def sample(self, inputs: int, size: int) -> dict[str, AnyArray]:
        """Sample the weights."""
        priors = self.priors(inputs, size).items()
        return {name: jnp.asarray(numpyro.sample(name, prior)) for name, prior in priors}

    def __call__(
        self,
        a: Float[AnyArray, "n f"],
        weights: Mapping[str, AnyArray],
        centres: Float[AnyArray, "h f"],
    ) -> Float[Array, "n q"]:
        """Give the latent points of observations."""
        if self.kind == "identity":
            return jnp.asarray(a)
        x = jnp.asarray(a) @ weights[PREFIX + "linear"]
        if self.kind == "linear":
            return x
        return x + self._features(a, weights, centres) @ weights[PREFIX + "out"]

    def _features(
        self, a: AnyArray, weights: Mapping[str, AnyArray], centres: AnyArray
    ) -> Float[Array, "n h"]:
        a, centres = jnp.asarray(a), jnp.asarray(centres)
        if self.kind == "mlp":
            return jnp.tanh(a @ weights[PREFIX + "hidden"] + weights[PREFIX + "bias"])
        squares = jnp.sum(a**2, axis=1)[:, None] + jnp.sum(centres**2, axis=1)
        apart = jnp.maximum(squares - 2.0 * a @ centres.T, 0.0)
        return jnp.exp(-0.5 * apart / (a.shape[1] * self.length**2))

    def start(
        self,
        a: Float[np.ndarray, "n f"],
        x: Float[np.ndarray, "n q"],
        centres: Float[np.ndarray, "h f"],
        random: np.random.Generator,
    ) -> dict[str, np.ndarray]:
        """Give weights whose map is near x: the most likely ones under their priors.

        The noise is a tenth of the spread of x; hidden units are drawn from their prior.
        """
        if self.kind == "identity":
            return {}
        inputs, size = a.shape[1], x.shape[1]
        weights: dict[str, np.ndarray] = {}
        design, precision = [a], [np.full(inputs, float(inputs))]
        if self.kind == "mlp":
            weights[PREFIX + "hidden"] = random.normal(size=(inputs, self.hidden)) / inputs**0.5
            weights[PREFIX + "bias"] = random.normal(size=self.hidden)
        if self.kind != "linear":
            design.append(np.asarray(self._features(a, weights, centres)))
            precision.append(np.full(self.hidden, self.hidden / self.spread**2))
        phi, ridge = np.concatenate(design, axis=1), np.concatenate(precision)
        noise = 0.01 * np.mean(x**2)
        found = np.linalg.solve(phi.T @ phi + noise * np.diag(ridge), phi.T @ x)
        weights[PREFIX + "linear"] = found[:inputs]
        if self.kind != "linear":
            weights[PREFIX + "out"] = found[inputs:].reshape(self.hidden, size)
        return weights

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of the weights."""
        every = {
            "linear": ("back_input", "back_output"),
            "out": ("back_unit", "back_output"),
            "hidden": ("back_input", "back_unit"),
            "bias": ("back_unit",),
        }
        return {PREFIX + name: dims for name, dims in every.items()}
