"""Compute the decay of an amplitude under sums of damping terms, averaged over a cycle."""
