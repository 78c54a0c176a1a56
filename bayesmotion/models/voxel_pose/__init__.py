"""Poses from voxels (Sun et al. 2006): a mixture of PPCA, and relevance vectors on its features."""
