"""Whether a fit is to be trusted, and which of several explains the recordings better."""
