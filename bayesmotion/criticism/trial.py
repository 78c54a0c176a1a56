"""What a calibration asks of a model, whatever the model.

A trial is a model small enough to be fitted hundreds of times, and beside it

    draw          an exact draw of the joint distribution: all sites, and data with the
                  outcomes in their place
    shuffle       data whose outcomes are in a wrong order, as far as the model cares
    quantities    what the data can tell of a draw, no rotation, label or sign with it
    prior         the site whose prior is too narrow when the fault is in the prior
    noise         the sites that say how large the noise is, and how they say it

Data come beside the trial: a pytree of arrays whose outcomes are not looked at.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray
from numpyro import handlers

from ..gp.linalg import AnyArray
from ..models.registry import Collapsible

Values = dict[str, Array]
Meaning = Literal["precision", "variance", "log_odds"]


@dataclass(frozen=True)
class Trial:
    """A small model and how it is drawn from, spoilt and looked at; see the module.

    Functions are the module's own, not made anew, so that equal trials share a
    compilation; their first argument is the model.

    model
        With its settings.
    draw
        Of (model, key, data).
    shuffle
        Of (key, data).
    quantities
        Of (model, data, values).
    prior
        Name of a site with a normal or log-normal prior.
    noise
        Sites by name: a ``precision`` or a ``variance``, or the ``log_odds`` of the
        share that is not noise.
    """

    model: Any
    draw: Callable[[Any, PRNGKeyArray, Any], tuple[Values, Any]]
    shuffle: Callable[[PRNGKeyArray, Any], Any]
    quantities: Callable[[Any, Any, Mapping[str, AnyArray]], Values]
    prior: str
    noise: tuple[tuple[str, Meaning], ...]

    @property
    def program(self) -> str:
        """Name of the program that is fitted: that with sites integrated out, if there is one."""
        return "collapsed" if isinstance(self.model, Collapsible) else "program"


def draw_sites(
    model: Any, key: PRNGKeyArray, data: Any, known: Mapping[str, AnyArray] | None = None
) -> Values:
    """Draw every site of a program, observed ones too, with what they determine.

    Parameters
    ----------
    model
        With a program of `data`.
    key
        Random key.
    data
        The program's argument.
    known
        Values of sites that have been drawn already.
    """
    given = {name: jnp.asarray(value) for name, value in (known or {}).items()}
    program = handlers.substitute(handlers.uncondition(model.program), data=given)
    sites = handlers.trace(handlers.seed(program, key)).get_trace(data)
    kept = ("sample", "deterministic")
    return {name: site["value"] for name, site in sites.items() if site["type"] in kept}


def shuffled(
    key: PRNGKeyArray, y: Float[AnyArray, "n d"], group: Int[AnyArray, " n"]
) -> Float[Array, "n d"]:
    """Put the rows of every group, such as the frames of a clip, in a random order."""
    chance = jax.random.uniform(key, group.shape)
    return jnp.asarray(y)[jnp.lexsort((chance, jnp.asarray(group)))]


def logs(values: Mapping[str, AnyArray], names: tuple[str, ...]) -> Values:
    """Give the logarithms of positive sites, those of the names that there are."""
    return {f"log_{name}": jnp.log(values[name]) for name in names if name in values}
