"""Whole jobs from data to tables and pictures: the demonstration, published studies."""
