"""What averaging over the pace of new clips is worth, on the six-clip study."""
