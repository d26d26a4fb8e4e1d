"""Envelopes as they were recorded, and where the free decay stands in them."""
