"""Compare bayesdamp with other methods of measuring damping on the same records: `python -m validation.contest`."""
