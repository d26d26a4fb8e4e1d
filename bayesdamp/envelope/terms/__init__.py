"""Registered damping terms in an envelope: what a cycle loses to them, and their own parameters."""
