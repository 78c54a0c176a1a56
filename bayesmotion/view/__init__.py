"""Motions seen moving: one page with all it needs, for browsers and notebooks."""

from .viewer import View, view

__all__ = ["View", "view"]
