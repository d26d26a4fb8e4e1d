"""Sections on each record."""
