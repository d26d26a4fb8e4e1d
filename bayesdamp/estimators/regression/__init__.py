"""Provide numerical functions for the methods that regress on candidate terms."""
