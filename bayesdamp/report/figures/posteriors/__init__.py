"""Figures of posteriors and evidence."""
