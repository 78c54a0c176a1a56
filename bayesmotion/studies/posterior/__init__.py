"""The study of posteriors and their forecasts."""
