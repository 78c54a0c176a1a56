"""Voice puppetry: sound drives a face through a chain of facial states (Brand 1999)."""

from .program import VoicePuppetry

__all__ = ["VoicePuppetry"]
