"""Figures of a record and its fits."""
