"""Fitting: the optimiser and the point estimates."""
