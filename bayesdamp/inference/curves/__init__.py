"""Quantities that follow from draws."""
