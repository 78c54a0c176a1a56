"""Negative controls: a check that never fails says nothing, so each of these must fail.

prior    the fit takes the spread of one prior for a third of what it is
frames   the frames are shuffled before the fit sees them
noise    the fit takes the variance of the noise for four times what it is
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array
from numpyro import distributions as dist
from numpyro.primitives import Messenger

from ..model import NoiseMeaning, SBCCase

Control = Literal["none", "prior", "frames", "noise"]
CONTROLS: tuple[Control, ...] = ("prior", "frames", "noise")


class Faults(NamedTuple):
    """What is wrong, in numbers, so that right and wrong share one compilation.

    spread
        Factor of the spread of the trial's prior, in the logarithm where it is log-normal.
    shuffle
        Whether frames are shuffled.
    noise
        Factor of the variance of the independent noise.
    """

    spread: float = 1.0
    shuffle: bool = False
    noise: float = 1.0


FAULTS: dict[Control, Faults] = {
    "none": Faults(),
    "prior": Faults(spread=1.0 / 3.0),
    "frames": Faults(shuffle=True),
    "noise": Faults(noise=4.0),
}


class _Wrong(Messenger):
    """Change one prior, and what a program goes on with where a site is about its noise."""

    def __init__(self, case: SBCCase, faults: Faults) -> None:
        self.case, self.faults = case, faults
        super().__init__(None)

    def process_message(self, msg: dict) -> None:
        """Put the wrong prior in the place of the right one."""
        if msg["name"] == self.case.prior:
            msg["fn"] = narrowed(msg["fn"], self.faults.spread)

    def postprocess_message(self, msg: dict) -> None:
        """Hand the program the wrong noise; the site keeps its value, and its prior."""
        for name, meaning in self.case.noise:
            if msg["name"] == name:
                msg["value"] = noisier(msg["value"], meaning, self.faults.noise)


def narrowed(right: Any, factor: Any) -> Any:
    """Give a normal or log-normal distribution another spread."""
    if isinstance(right, dist.Independent):
        return narrowed(right.base_dist, factor).to_event(right.reinterpreted_batch_ndims)
    if isinstance(right, dist.ExpandedDistribution):
        return narrowed(right.base_dist, factor).expand(right.batch_shape)
    return type(right)(right.loc, factor * right.scale)


def noisier(value: Any, meaning: NoiseMeaning, factor: Any) -> Array:
    """Change a number that says how large the noise is, as if its variance were larger."""
    if meaning == "variance":
        return value * factor
    return value / factor if meaning == "precision" else value - jnp.log(factor)


@dataclass(frozen=True)
class Wrong:
    """A trial's model with faults, as far as its density goes."""

    case: SBCCase
    faults: Faults

    def program(self, data: Any) -> None:
        """Run the program that is fitted, wrongly."""
        with _Wrong(self.case, self.faults):
            getattr(self.case.model, self.case.program)(data)
