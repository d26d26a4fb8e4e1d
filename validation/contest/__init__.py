"""What people measure damping with today, beside us on the same records: `python -m validation.contest`."""
