"""Numerics that the methods which regress on candidate terms share."""
