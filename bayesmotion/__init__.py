"""Bayesian models of human motion."""

import jax

# Every factorisation of a covariance here is done in double precision: the
# kernel matrices of smooth motion have condition numbers far above 1e7.
jax.config.update("jax_enable_x64", True)

__version__ = "0.1.0"
