"""Multivariate relevance vector machine."""

from .program import RelevanceVectors

__all__ = ["RelevanceVectors"]
