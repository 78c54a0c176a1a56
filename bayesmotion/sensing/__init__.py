"""What a motion looks like to a sensor: bodies, cameras, silhouettes, voxels and their shape."""
