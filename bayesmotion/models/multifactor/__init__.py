"""The multifactor Gaussian process model (Wang, Fleet and Hertzmann 2007)."""

from .model import Multifactor
from .settings import OU, Circle, Factor, GPDynamics, White

__all__ = ["OU", "Circle", "Factor", "GPDynamics", "Multifactor", "White"]
