"""Settings of the multifactor model: what moves, what is left over, and who moves how."""

from dataclasses import dataclass
from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Float
from numpyro import distributions as dist

from ...errors import InputError
from ...gp.linalg import AnyArray


@dataclass(frozen=True)
class Circle:
    """Content on a circle, at a steady pace: periodic motion."""


@dataclass(frozen=True)
class GPDynamics:
    """Content on a path with Gaussian process dynamics: motion of any kind.

    Parameters
    ----------
    size
        Q, the dimensions of the path.
    order
        1, the paper's, where a place of the latent space has one speed, or 2, where a path
        goes on at the speed it came.
    noise_sd
        Standard deviation of a step of x about its mean, with x of unit scale. It is set, not
        estimated: as it goes to zero, paths can be found that make the density of the dynamics
        as large as one likes.
    balanced
        Whether the log density of the dynamics counts D / Q times (B-GPDM).
    """

    size: int = 3
    order: Literal[1, 2] = 2
    noise_sd: float = 0.03
    balanced: bool = False


@dataclass(frozen=True)
class White:
    """No residual beside independent noise, as in the paper."""


@dataclass(frozen=True)
class OU:
    """Clips deviate from what the factors make of them by an Ornstein-Uhlenbeck process.

    Parameters
    ----------
    per_clip
        Whether its size and time scale are each clip's own, or one for all clips. Each clip's
        own: a new clip of a new person deviates farther than the training clips do, and its
        intervals are wider; but at the mode the residual can also take the place of what the
        factors should explain.
    """

    per_clip: bool = True


@dataclass(frozen=True)
class Factor:
    """One style factor: its label, the size of its vectors, and how it enters.

    Parameters
    ----------
    name
        The label of clips.
    size
        Dimensions of its vectors.
    kind
        ``linear`` (the paper) or ``rbf``, which gives up the multilinear form.
    novel_dims
        Dimensions that vectors of new levels have beyond those, zero for the trained ones; for
        a linear factor. The vectors of S levels and more span R^S, so that without novel
        dimensions a new person is a mixture of those known. What these do not have goes into
        the novel ones: it repeats with the content, while a residual is forgotten. An rbf
        factor has none; None: one for a linear factor.
    """

    name: str
    size: int = 3
    kind: Literal["linear", "rbf"] = "linear"
    novel_dims: int | None = None

    def __post_init__(self) -> None:
        """Refuse novel dimensions that mean nothing."""
        dims = self.novel_dims
        if dims is None:
            object.__setattr__(self, "novel_dims", 1 if self.kind == "linear" else 0)
        elif dims < 0 or (dims and self.kind == "rbf"):
            raise InputError(
                f"factor {self.name!r}, novel_dims {dims}",
                "only a linear factor has novel dimensions, none or more",
                "Use kind 'linear', or novel_dims 0",
            )

    @property
    def novel(self) -> int:
        """The number of novel dimensions."""
        assert self.novel_dims is not None
        return self.novel_dims

    def padded(self, styles: Float[AnyArray, "l s"]) -> Float[Array, "l e"]:
        """Return trained vectors (or points) with their novel dimensions, which are zero."""
        return jnp.pad(jnp.asarray(styles), ((0, 0), (0, self.novel)))


SUBJECT_AND_GAIT = (Factor("subject"), Factor("gait"))


def standard_styles(levels: int, size: int) -> dist.Distribution:
    """Return the distribution of independent standard normal style vectors."""
    return dist.Normal(0.0, 1.0).expand([levels, size]).to_event(2)
