"""Conditions compared over people, and what else is asked of gait."""
