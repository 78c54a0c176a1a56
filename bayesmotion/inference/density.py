"""The log density of a program as a function of numbers on the real line.

Positive sites are searched by their logarithm, but the density is that of the
site itself: a MAP estimate is the mode in the site's own units, as in the papers.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array
from numpyro.infer.util import log_density

POSITIVE = frozenset({"gamma", "beta", "scale", "step", "alpha", "drift", "drift_time"})


@dataclass(frozen=True)
class ProgramDensity:
    """Log density of ``model.program(*data)``; equal models share one compilation."""

    model: Any
    positive: frozenset[str] = field(default=POSITIVE)

    def __call__(self, real: Mapping[str, ArrayLike], data: tuple) -> Array:
        """Evaluate at site values on the real line; `data` are the program's arguments."""
        return jnp.asarray(log_density(self.model.program, data, {}, self.natural(real))[0])

    def natural(self, real: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """Take values on the real line to the sites' own units."""
        return {k: jnp.exp(v) if k in self.positive else jnp.asarray(v) for k, v in real.items()}

    def real(self, natural: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """Take values in the sites' own units to the real line."""
        return {k: jnp.log(v) if k in self.positive else jnp.asarray(v) for k, v in natural.items()}
