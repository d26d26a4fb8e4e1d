"""Simulate records with a known truth, without the code under test."""
