"""Damping terms, restoring laws and trajectories: JAX in float64, without any knowledge of data."""
