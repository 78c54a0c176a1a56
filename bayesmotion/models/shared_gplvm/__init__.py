"""Views that share one latent path: sound and face (Deena and Galata 2009)."""

from .back_constraint import MLP, RBF, BackConstraint, Identity, Linear
from .program import Dynamics, Inducing, SharedGPLVM
from .window import ContextWindow

__all__ = [
    "MLP",
    "RBF",
    "BackConstraint",
    "ContextWindow",
    "Dynamics",
    "Identity",
    "Inducing",
    "Linear",
    "SharedGPLVM",
]
