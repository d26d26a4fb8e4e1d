"""Peers that need no package beyond ours; one a file, each from times, displacements and amplitudes to a `Reply`."""
