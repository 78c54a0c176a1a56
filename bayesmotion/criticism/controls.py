"""Negative controls: a check that never fails says nothing, so each of these must fail.

prior    the fit takes the spread of the prior of log gamma for a third of what it is
frames   the frames of every clip are shuffled before the fit sees them
noise    the fit takes the variance of the independent noise for four times 1 / beta
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray
from numpyro import distributions as dist
from numpyro.primitives import Messenger

from ..gp.collapsed import CollapsedProcess
from ..gp.linalg import AnyArray
from ..models.poses import Frames

Control = Literal["none", "prior", "frames", "noise"]
CONTROLS: tuple[Control, ...] = ("prior", "frames", "noise")


class Faults(NamedTuple):
    """What is wrong, in numbers, so that right and wrong share one compilation.

    spread
        Factor of the spread of the prior of log gamma.
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
    """Change what a program says about its sites."""

    def __init__(self, faults: Faults) -> None:
        self.faults = faults
        self.beta: Any = None
        super().__init__(None)

    def process_message(self, msg: dict) -> None:
        """Put the wrong distribution in the place of the right one."""
        right: Any = msg.get("fn")
        if msg["name"] == "gamma":
            msg["fn"] = dist.LogNormal(right.loc, self.faults.spread * right.scale)
        if msg["name"] == "y":
            more = (self.faults.noise - 1.0) / self.beta * jnp.eye(right.K.shape[-1])
            msg["fn"] = CollapsedProcess(right.K + more, right.event_shape[1], right.missing)

    def postprocess_message(self, msg: dict) -> None:
        """Keep the noise's precision for later."""
        if msg["name"] == "beta":
            self.beta = msg["value"]


@dataclass(frozen=True)
class Wrong:
    """A model whose program has faults."""

    model: Any
    faults: Faults

    def collapsed(self, frames: Frames) -> None:
        """Generate the poses with the scales integrated out, wrongly."""
        with _Wrong(self.faults):
            self.model.collapsed(frames)

    def complete_draw(
        self, key: PRNGKeyArray, frames: Frames, values: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Draw the scales as the model does."""
        return self.model.complete_draw(key, frames, values)


def shuffled(
    key: PRNGKeyArray, y: Float[Array, "n d"], clip: Int[AnyArray, " n"]
) -> Float[Array, "n d"]:
    """Put the frames of every clip in a random order."""
    chance = jax.random.uniform(key, clip.shape)
    return y[jnp.lexsort((chance, jnp.asarray(clip)))]
