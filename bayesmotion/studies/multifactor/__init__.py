"""The study of the multifactor paper."""
