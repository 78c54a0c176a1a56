"""Joint gait-pose manifolds: walks around or on a torus, a cylinder, a circle."""

from .program import GaitPose
from .settings import (
    Around,
    Circle,
    Cylinder,
    LatentSpace,
    NoSurface,
    OnSurface,
    PathDynamics,
    Torus,
)
from .variants import SCALES, VARIANTS

__all__ = [
    "SCALES",
    "VARIANTS",
    "Around",
    "Circle",
    "Cylinder",
    "GaitPose",
    "LatentSpace",
    "NoSurface",
    "OnSurface",
    "PathDynamics",
    "Torus",
]
