"""Mixture of probabilistic principal component analysers."""

from .program import MixturePPCA

__all__ = ["MixturePPCA"]
