"""Coordinates in which a posterior is round, and distributions that approximate it."""
