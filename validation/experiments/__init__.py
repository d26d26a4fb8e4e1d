"""Experiments with simulated records of known truth; docs/validation.md lists their results."""
