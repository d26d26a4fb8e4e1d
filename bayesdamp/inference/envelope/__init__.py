"""Inference from an envelope: its noise, the evidence of damping sums, and their posterior."""
