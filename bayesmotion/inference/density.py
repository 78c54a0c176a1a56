"""The log density of a program as a function of numbers on the real line.

Every site is searched or sampled on the real line, by the map that NumPyro has for
its support (`biject_to`). A point estimate is the mode of the density of the sites
themselves, as in the papers; a sampler moves on the real line and needs the density
there, which has the Jacobians of those maps.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpyro
from jax.typing import ArrayLike
from jaxtyping import Array
from numpyro import distributions as dist
from numpyro.handlers import substitute, trace
from numpyro.infer.util import log_density


@runtime_checkable
class RealDensity(Protocol):
    """The log density of a program in coordinates without bounds, as `ProgramDensity`."""

    @property
    def program(self) -> str:
        """Name of the method that is the program."""
        ...

    def __call__(self, real: Mapping[str, ArrayLike], data: tuple) -> Array:
        """Evaluate at coordinates of every site."""
        ...

    def natural(self, real: Mapping[str, ArrayLike], data: tuple) -> dict[str, Array]:
        """Take coordinates to the sites' own units, with what they determine."""
        ...

    def real(self, natural: Mapping[str, ArrayLike], data: tuple) -> dict[str, Array]:
        """Take values in the sites' own units to coordinates."""
        ...


@dataclass(frozen=True)
class ProgramDensity:
    """Log density of a model's program; equal models share one compilation.

    model
        The model with its settings.
    program
        Name of the method that is its program.
    jacobian
        Whether the density is that on the real line, else that of the sites.
    """

    model: Any
    program: str = "program"
    jacobian: bool = False

    def __call__(self, real: Mapping[str, ArrayLike], data: tuple) -> Array:
        """Evaluate at site values on the real line; `data` are the program's arguments."""
        return jnp.asarray(log_density(self._at(real, self.jacobian), data, {}, {})[0])

    def natural(self, real: Mapping[str, ArrayLike], data: tuple) -> dict[str, Array]:
        """Take values on the real line to the sites' own units, with what they determine."""
        sites = trace(self._at(real, jacobian=False)).get_trace(*data)
        kept = ("sample", "deterministic")
        return {
            name: jnp.asarray(site["value"])
            for name, site in sites.items()
            if site["type"] in kept and not site.get("is_observed", False)
        }

    def real(self, natural: Mapping[str, ArrayLike], data: tuple) -> dict[str, Array]:
        """Take values in the sites' own units to the real line."""
        values = {name: jnp.asarray(value) for name, value in natural.items()}
        sites = trace(substitute(self._program, data=values)).get_trace(*data)
        return {
            name: jnp.asarray(dist.biject_to(site["fn"].support).inv(values[name]))
            for name, site in sites.items()
            if site["type"] == "sample" and not site["is_observed"]
        }

    @property
    def _program(self) -> Any:
        return getattr(self.model, self.program)

    def _at(self, real: Mapping[str, ArrayLike], jacobian: bool) -> Any:
        """Give the program with its sites put where `real` says."""

        def place(site: dict) -> Array | None:
            if site["type"] != "sample" or site["name"] not in real:
                return None
            to_support = dist.biject_to(site["fn"].support)
            at = jnp.asarray(real[site["name"]])
            value = jnp.asarray(to_support(at))
            if jacobian:
                log_det = jnp.sum(to_support.log_abs_det_jacobian(at, value))
                numpyro.factor(f"_{site['name']}_log_det", log_det)
            return value

        return substitute(self._program, substitute_fn=place)


# Compiled, they compute what they return alone, and not the densities of the program as well.
@partial(jax.jit, static_argnames="density")
def natural_values(
    density: RealDensity, real: Mapping[str, Array], data: tuple
) -> dict[str, Array]:
    """Return `RealDensity.natural`, compiled: for numbers, where nothing is traced yet."""
    return density.natural(real, data)


@partial(jax.jit, static_argnames="density")
def real_values(
    density: RealDensity, natural: Mapping[str, Array], data: tuple
) -> dict[str, Array]:
    """Return `RealDensity.real`, compiled: for numbers, where nothing is traced yet."""
    return density.real(natural, data)


def sites_of(program: Any, data: tuple) -> dict[str, dict[str, Any]]:
    """Return what the sites of a program are, by name; nothing is computed, values are abstract.

    Parameters
    ----------
    program
        A function, or a NumPyro handler of one, with a value for every site: seeded or
        substituted.
    data
        Its arguments.
    """
    found: dict[str, dict[str, Any]] = {}

    def look(*data: Any) -> None:
        found.update(trace(program).get_trace(*data))

    jax.eval_shape(look, *data)
    return found
