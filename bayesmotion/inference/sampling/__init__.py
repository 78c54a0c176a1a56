"""Samplers, and the whitened unknowns that they move on."""
