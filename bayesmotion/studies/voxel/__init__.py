"""The study of the voxel paper."""
