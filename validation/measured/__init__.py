"""Compute the answers of bayesdamp on published measurements of decays, whose true damping is not known."""
