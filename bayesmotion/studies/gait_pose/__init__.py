"""The study of the gait-pose paper."""
