"""Priors on latent paths."""
