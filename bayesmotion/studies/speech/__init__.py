"""The study of the speech paper."""
