"""Compute answers on published measurements of decays, for which no truth is known."""
