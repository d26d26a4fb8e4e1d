"""Posteriors as ArviZ reads them."""
