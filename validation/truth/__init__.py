"""Simulate records with a known truth, by a solver that does not use the code of the package."""
