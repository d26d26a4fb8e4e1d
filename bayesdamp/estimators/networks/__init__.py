"""Numerics that the methods which train a network share."""
