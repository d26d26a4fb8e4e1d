"""Peers that need no further packages. Each is a function of times, displacements and amplitudes to a `Reply`."""
