"""The models, one file each, and the arrays they see."""
