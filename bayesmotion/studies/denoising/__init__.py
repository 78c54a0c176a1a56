"""Noise taken out of recordings, against the filter of gait laboratories."""
