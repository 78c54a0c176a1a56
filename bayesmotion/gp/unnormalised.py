"""Parts of a program's log density that are no log densities, and say so.

A bound on an evidence, or a product of densities without a known constant, can be made
large as any function can, and its mode is a point estimate. It is not to be sampled,
compared or calibrated as if exp of it were a density. The mark is in the program's own
trace, so that nobody who looks at it needs to know the model
(`inference.densities.require_densities`).
"""

from dataclasses import dataclass
from typing import ClassVar

import jax
import numpyro
from numpyro import distributions as dist

from .linalg import AnyArray


@dataclass(frozen=True)
class NoDensity:
    """Why a part of a log density is none.

    what
        What is wrong, for a message.
    what_to_do
        A way out, for a message.
    depends_on
        Sites that the missing constant depends on: with all of these fixed it is a constant,
        and nothing is missing. Empty where it is no density whatever is fixed.
    """

    what: str
    what_to_do: str
    depends_on: tuple[str, ...] = ()


class MarkedFactor(dist.Unit):
    """The distribution behind `factor`: a log factor with its mark."""

    pytree_aux_fields = ("no_density",)

    def __init__(self, log_factor, no_density):
        self.no_density = no_density
        super().__init__(log_factor)


class Marked(dist.Distribution):
    """A distribution whose `log_prob` lacks its constant, with its mark.

    Parameters
    ----------
    base
        What is evaluated and drawn from; with no batch dimensions.
    no_density
        The mark.
    """

    arg_constraints: ClassVar = {}
    pytree_data_fields = ("base",)
    pytree_aux_fields = ("no_density",)

    def __init__(self, base, no_density, *, validate_args=None):
        self.base, self.no_density = base, no_density
        super().__init__(base.batch_shape, base.event_shape, validate_args=False)

    @property
    def support(self):
        """That of the base."""
        return self.base.support

    def log_prob(self, value):
        """Evaluate the base."""
        return self.base.log_prob(value)

    def sample(self, key=None, sample_shape=()):
        """Draw from the base, whose draws are not those of the product."""
        return self.base.sample(key, sample_shape)


def factor(name: str, log_factor: AnyArray | jax.Array, no_density: NoDensity) -> None:
    """Add a term to a program's log density that is no log density, as `numpyro.factor`."""
    marked = MarkedFactor(log_factor, no_density)
    numpyro.sample(name, marked, obs=marked.sample(None), infer={"is_auxiliary": True})
