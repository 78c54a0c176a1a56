"""Keyposes: which energy minima near musical beats are keyposes (Perera, Kudoh and Ikeuchi)."""

from .program import Keyposes

__all__ = ["Keyposes"]
