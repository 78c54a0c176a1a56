"""Faces: video, landmarks, appearance models, and made-up talkers."""
