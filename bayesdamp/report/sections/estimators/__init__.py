"""Sections on point estimates."""
