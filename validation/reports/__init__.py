"""Make the shipped reports, record which code made each of them, and find out which ones are stale."""
