"""Quantities computed from posterior draws."""
