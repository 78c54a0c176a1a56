"""Motion tensor: who moves and what they do, from whole segments (Perera, Kudoh and Ikeuchi)."""

from .program import MotionTensor

__all__ = ["MotionTensor"]
