"""Figures of point estimates."""
