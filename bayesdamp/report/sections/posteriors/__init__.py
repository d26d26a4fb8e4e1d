"""Sections on posteriors and evidence."""
