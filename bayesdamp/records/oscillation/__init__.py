"""Measure an oscillation in a record without assuming a damping law or a restoring law."""
