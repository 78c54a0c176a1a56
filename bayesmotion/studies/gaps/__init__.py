"""Gaps of markers in public recordings."""
