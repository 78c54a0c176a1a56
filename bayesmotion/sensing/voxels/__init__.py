"""Bodies seen by cameras: silhouettes, hulls, voxels and their shape."""
