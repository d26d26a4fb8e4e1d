"""Provide general numerical methods that do not depend on oscillations."""
