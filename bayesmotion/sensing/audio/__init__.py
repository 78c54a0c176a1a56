"""Sound: cepstra, beats."""
