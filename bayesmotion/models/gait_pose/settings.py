"""The settings of a gait-pose model: what its latent points keep to, and their dynamics.

Each class has the settings it looks at, and no others.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from ...errors import InputError

Shape = Literal["torus", "cylinder", "circle"]


def _positive(where: str, **values: float | int) -> None:
    for name, value in values.items():
        if not value > 0:
            raise InputError(f"{where}: {name}", f"it is {value}", "Give a number above zero")


@dataclass(frozen=True)
class Around:
    """Latent points that are free around a surface, each drawn to what its neighbours make of it.

    Parameters
    ----------
    sigma
        Scale of a point's residual from its neighbours' weighted mean; the smaller, the
        more the surface counts and the less the data.
    latent_sd
        Standard deviation about the origin, which makes the prior proper.
    """

    sigma: float = 0.1
    latent_sd: float = 2.0

    def __post_init__(self) -> None:
        """Refuse scales that are none."""
        _positive("around a surface", sigma=self.sigma, latent_sd=self.latent_sd)


@dataclass(frozen=True)
class OnSurface:
    """Latent points on the surface itself, at coordinates that are free.

    Parameters
    ----------
    phase_sd
        Standard deviation of how far ahead a cycle is, in poses.
    gait_sd
        Of where along the surface a gait lies, in gaits.
    radius_sd
        Of the logarithm of a layer's radius.
    """

    phase_sd: float = 1.0
    gait_sd: float = 1.0
    radius_sd: float = 0.2

    def __post_init__(self) -> None:
        """Refuse scales that are none."""
        _positive(
            "on a surface",
            phase_sd=self.phase_sd, gait_sd=self.gait_sd, radius_sd=self.radius_sd,
        )  # fmt: skip


@dataclass(frozen=True)
class Torus(Around):
    """Poses around a circle, gaits along a closed tour; latent points around the torus."""

    shape: ClassVar[Shape] = "torus"


@dataclass(frozen=True)
class OnTorus(OnSurface):
    """Poses around a circle, gaits along a closed tour; latent points on the torus."""

    shape: ClassVar[Shape] = "torus"


@dataclass(frozen=True)
class Cylinder(Around):
    """Poses around a circle, gaits along an open path; latent points around the cylinder."""

    shape: ClassVar[Shape] = "cylinder"


@dataclass(frozen=True)
class OnCylinder(OnSurface):
    """Poses around a circle, gaits along an open path; latent points on the cylinder."""

    shape: ClassVar[Shape] = "cylinder"


@dataclass(frozen=True)
class PoseCircle(Around):
    """Poses around a circle, gaits in no order."""

    shape: ClassVar[Shape] = "circle"


@dataclass(frozen=True)
class NoSurface:
    """Latent points x ~ N(0, latent_sd^2) in `latent_size` dimensions.

    Parameters
    ----------
    latent_size
        Q.
    latent_sd
        Standard deviation.
    """

    latent_size: int = 3
    latent_sd: float = 2.0

    def __post_init__(self) -> None:
        """Refuse what has no size."""
        _positive("without a surface", latent_size=self.latent_size, latent_sd=self.latent_sd)


@dataclass(frozen=True)
class PathDynamics:
    """Gaussian process dynamics of first order of the latent path of a cycle, at unit scale.

    Parameters
    ----------
    noise_sd
        Standard deviation of a step about its mean.
    alpha
        Variance, inverse squared length and linear variance of the process, where they are
        fixed. Where None they are searched for: then the prior of the latent points, a
        product, has a normaliser that depends on them and is not known.
    """

    noise_sd: float = 0.03
    alpha: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        """Refuse what is no scale."""
        _positive("dynamics", noise_sd=self.noise_sd)
        if self.alpha is not None:
            names = ("variance", "gamma", "linear_variance")
            _positive("dynamics", **dict(zip(names, self.alpha, strict=True)))


LatentSpace = Torus | Cylinder | PoseCircle | OnTorus | OnCylinder | NoSurface
