"""Peers that need no further package. Each file has a function of times, displacements and amplitudes to a `Reply`."""
