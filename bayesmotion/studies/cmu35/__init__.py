"""The board of CMU subject 35: 3 frames of a walk given, 297 predicted."""
