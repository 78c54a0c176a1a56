"""Negative controls: a check that never fails says nothing.

Gross ones, each of which must fail:

    prior          the fit takes the sd of one prior for a third of what it is
    frames         the frames are shuffled before the fit sees them
    noise          the fit takes the variance of the noise for four times what it is

Subtle ones, which tell the power of a number of simulations:

    narrow_prior   the fit takes the sd of that prior for two thirds of what it is
    noise_sd       the fit takes the sd of the noise for 1.2 times what it is
    lag            outcomes come one row late within every clip
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array
from numpyro import distributions as dist
from numpyro.primitives import Messenger

from ...model import NoiseMeaning, SBCCase

GROSS: tuple[str, ...] = ("prior", "frames", "noise")
SUBTLE: tuple[str, ...] = ("narrow_prior", "noise_sd", "lag")
CONTROLS: tuple[str, ...] = (*GROSS, *SUBTLE)


class Faults(NamedTuple):
    """What is wrong, in numbers, so that right and wrong share one compilation.

    prior_sd
        Factor of the sd of the case's prior, in the logarithm where it is log-normal.
    shuffle
        Whether frames are shuffled.
    noise
        Factor of the variance of the independent noise.
    lag
        Whether outcomes come one row late.
    """

    prior_sd: float = 1.0
    shuffle: bool = False
    noise: float = 1.0
    lag: bool = False


FAULTS: dict[str, Faults] = {
    "none": Faults(),
    "prior": Faults(prior_sd=1.0 / 3.0),
    "frames": Faults(shuffle=True),
    "noise": Faults(noise=4.0),
    "narrow_prior": Faults(prior_sd=2.0 / 3.0),
    "noise_sd": Faults(noise=1.2**2),
    "lag": Faults(lag=True),
}


def shifted(case: SBCCase, data: Any, seen: Any) -> Any:
    """Return drawn data with their outcomes one row late.

    Parameters
    ----------
    case
        Says how; where it does not, what differs between `data` and `seen` is moved by a row.
    data
        What the draw was made with.
    seen
        What it gave.
    """
    if case.shift is not None:
        return case.shift(seen)
    # A draw puts new arrays in the place of outcomes and leaves all others as they are.
    return jax.tree.map(
        lambda before, after: after if after is before else jnp.roll(after, 1, axis=0), data, seen
    )


class _Wrong(Messenger):
    """Change one prior, and what a program goes on with where a site is about its noise."""

    def __init__(self, case: SBCCase, faults: Faults) -> None:
        self.case, self.faults = case, faults
        super().__init__(None)

    def process_message(self, msg: dict) -> None:
        """Put the wrong prior in the place of the right one."""
        if msg["name"] == self.case.prior:
            msg["fn"] = narrowed(msg["fn"], self.faults.prior_sd)

    def postprocess_message(self, msg: dict) -> None:
        """Hand the program the wrong noise; the site keeps its value, and its prior."""
        for name, meaning in self.case.noise:
            if msg["name"] == name:
                msg["value"] = noisier(msg["value"], meaning, self.faults.noise)


def narrowed(right: Any, factor: Any) -> Any:
    """Return a normal or log-normal distribution with another sd."""
    if isinstance(right, dist.Independent):
        return narrowed(right.base_dist, factor).to_event(right.reinterpreted_batch_ndims)
    if isinstance(right, dist.ExpandedDistribution):
        return narrowed(right.base_dist, factor).expand(right.batch_shape)
    return type(right)(right.loc, factor * right.scale)


def noisier(value: Any, meaning: NoiseMeaning, factor: Any) -> Array:
    """Change a number that says how large the noise is, as if its variance were larger."""
    if meaning == "sd":
        return value * jnp.sqrt(factor)
    if meaning == "variance":
        return value * factor
    return value / factor if meaning == "precision" else value - jnp.log(factor)


@dataclass(frozen=True)
class Wrong:
    """A case's model with faults, as far as its density goes."""

    case: SBCCase
    faults: Faults

    def program(self, data: Any) -> None:
        """Run the program that is fitted, wrongly."""
        with _Wrong(self.case, self.faults):
            getattr(self.case.model, self.case.program)(data)
