"""Poses from voxels (Sun et al. 2006): a mixture of PPCA, and relevance vectors on its features."""

from .data import voxel_recordings
from .mixture_ppca import MixturePPCA
from .program import VoxelPose
from .relevance_vectors import RelevanceVectors

__all__ = ["MixturePPCA", "RelevanceVectors", "VoxelPose", "voxel_recordings"]
