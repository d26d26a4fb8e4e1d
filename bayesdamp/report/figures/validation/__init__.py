"""Figures of calibration and model recovery."""
