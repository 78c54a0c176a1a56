"""The study of the keypose paper."""
