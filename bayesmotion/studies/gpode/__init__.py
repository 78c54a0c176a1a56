"""The boards of Gaussian process ODEs: the first pose of a walk or run given."""
