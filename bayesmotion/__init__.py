"""Bayesian models of human motion.

>>> import bayesmotion
>>> fit = bayesmotion.load("fit.nc")
"""

import os
from typing import TYPE_CHECKING, Any

# The covariance matrices here have hundreds of rows, where a second BLAS thread
# gains little; but on a busy machine waiting threads spin, and one evaluation has
# been seen to take fifteen times as long. Whoever sets the variable keeps their value.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

# Every factorisation of a covariance here is done in double precision: the
# kernel matrices of smooth motion have condition numbers far above 1e7.
jax.config.update("jax_enable_x64", True)

__version__ = "0.1.0"

if TYPE_CHECKING:
    from .fit import Fit, load

__all__ = ["Fit", "load"]


def __getattr__(name: str) -> Any:
    """Import what deals with fits when it is first asked for; reading files needs none of it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import fit

    return getattr(fit, name)
