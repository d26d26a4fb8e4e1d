"""Envelopes as they were recorded or simulated, and where the free decay stands in them."""
