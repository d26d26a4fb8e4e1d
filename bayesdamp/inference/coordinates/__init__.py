"""Coordinates in which a posterior is close to a normal distribution."""
