"""Sections on calibration and model recovery."""
