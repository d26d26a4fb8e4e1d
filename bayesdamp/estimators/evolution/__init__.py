"""Numerics that the methods which search by evolution share."""
