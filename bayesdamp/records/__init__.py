"""Read, clean, describe and simulate records of an oscillation."""
