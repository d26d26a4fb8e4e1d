"""Simulated records with a known truth, solved without the code that is judged."""
