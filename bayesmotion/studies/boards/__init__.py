"""Public benchmarks: arrays of motion on which others have published numbers."""
