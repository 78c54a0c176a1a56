"""Style factors of the multifactor model: who moves, and how."""

from dataclasses import dataclass
from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Float
from numpyro import distributions as dist

from ..errors import InputError
from ..gp.linalg import AnyArray


@dataclass(frozen=True)
class Factor:
    """One style factor: its label, the size of its vectors, and how it enters.

    kind
        ``linear`` (the paper) or ``rbf``, which gives up the multilinear form.
    spare
        Entries that vectors of new levels have beyond those, zero for the trained ones; for
        a linear factor, an rbf one has none (say ``spare=0``). The vectors of S levels and more
        span R^S, so that without spare entries a new person is a mixture of those known. What
        these do not have goes into the spare entries: it repeats with the content, while a
        drift is forgotten.
    """

    name: str
    size: int = 3
    kind: Literal["linear", "rbf"] = "linear"
    spare: int = 1

    def __post_init__(self) -> None:
        """Refuse spare entries that mean nothing."""
        if self.spare < 0 or (self.spare and self.kind == "rbf"):
            raise InputError(
                f"factor {self.name!r}, spare {self.spare}",
                "only a linear factor has spare entries, none or more",
                "Use kind 'linear', or spare 0",
            )

    def padded(self, styles: Float[AnyArray, "l s"]) -> Float[Array, "l e"]:
        """Give trained vectors (or points) their spare entries, which are zero."""
        return jnp.pad(jnp.asarray(styles), ((0, 0), (0, self.spare)))


SUBJECT_AND_GAIT = (Factor("subject"), Factor("gait"))


def standard_styles(levels: int, size: int) -> dist.Distribution:
    """Give independent standard normal style vectors."""
    return dist.Normal(0.0, 1.0).expand([levels, size]).to_event(2)
