"""Simulate records with a known truth, without using the code of the package."""
