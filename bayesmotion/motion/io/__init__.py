"""Motion files: reading and writing of every kind."""
