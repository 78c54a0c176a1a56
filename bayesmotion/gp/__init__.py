"""Gaussian processes: kernels, the matrix-normal distribution, conditioning."""
