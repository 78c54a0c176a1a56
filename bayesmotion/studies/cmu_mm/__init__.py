"""The board of CMU actions in millimetres: 10 frames given, 25 predicted."""
