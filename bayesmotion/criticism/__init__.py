"""Whether a fit can be trusted, and which of two models explains the data better."""
