"""What sensors give: sound and its beats; bodies seen by cameras, voxels and their shape."""
