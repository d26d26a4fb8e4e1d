"""Numerics that the methods share that regress on candidate terms."""
