"""Coordinates in which a posterior is nearly standard normal, and distributions that approximate it."""
