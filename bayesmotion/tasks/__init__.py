"""What a fit is for: forecasts, synthesis, and what they are held against."""
