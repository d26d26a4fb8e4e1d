"""Make the shipped reports, record which code made each of them, and list those whose code has changed since then."""
