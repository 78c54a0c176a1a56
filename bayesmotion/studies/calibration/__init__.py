"""The calibration of all models as they are shipped."""
