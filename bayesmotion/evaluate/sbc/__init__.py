"""Simulation-based calibration: cases, chains, controls and the test of ranks."""
