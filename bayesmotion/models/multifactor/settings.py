"""Settings of the multifactor model: what moves, what is left over, and who moves how."""

from dataclasses import dataclass, field
from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Float
from numpyro import distributions as dist

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...settings import BEFORE


@dataclass(frozen=True)
class Circle:
    """Content on a circle, at a steady pace: periodic motion.

    Parameters
    ----------
    pace
        What is known of a clip's step beforehand. ``free``: about a cycle a second, whatever
        other clips do. ``learned``: the steps of clips have a common mean, depend on the
        styles, and vary about what these make of them by an amount that the training clips
        tell (`pace`); a new clip has the pace of those it is like. With the paper's priors
        steps are free.
    wander_sd
        Standard deviation of the logarithm of a new clip's momentary speed about its pace
        (`pace.wandering`): a short context tells the speed at which it was passed, and that is
        not the clip's pace; further on the phase wanders. 0: the speed is the pace.
    """

    pace: Literal["free", "learned"] = field(default="free", metadata={BEFORE: "free"})
    wander_sd: float = field(default=0.0, metadata={BEFORE: 0.0})

    def __post_init__(self) -> None:
        """Refuse what is no standard deviation."""
        if not 0.0 <= self.wander_sd < 1.0:
            raise InputError(
                f"wander_sd {self.wander_sd:g}",
                "it is the sd of the logarithm of a speed",
                "Use a number from 0 to below 1",
            )


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
    new_levels
        What is known of the vectors of new levels beforehand, for a linear factor:
        ``isotropic``, as of the trained ones, all directions alike; or ``population``, a normal
        distribution whose mean and covariance the trained vectors tell. Where levels are many
        and alike, as takes of one person, that says much more of a new one.
    """

    name: str
    size: int = 3
    kind: Literal["linear", "rbf"] = "linear"
    novel_dims: int | None = None
    new_levels: Literal["isotropic", "population"] = field(
        default="isotropic", metadata={BEFORE: "isotropic"}
    )

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
        if self.kind == "rbf" and self.new_levels == "population":
            raise InputError(
                f"factor {self.name!r}, new_levels 'population'",
                "only of a linear factor it is known how the trained vectors are spread",
                "Use kind 'linear', or new_levels 'isotropic'",
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
