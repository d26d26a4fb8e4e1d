"""Numerical methods that know nothing of oscillations."""
