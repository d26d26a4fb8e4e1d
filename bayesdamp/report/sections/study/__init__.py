"""Sections on the study as a whole."""
