"""Answers on decays that others measured; no truth is known."""
