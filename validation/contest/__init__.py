"""Compare bayesdamp with an engineer's script on the same records: `python -m validation.contest`.

A peer is one of the methods that take part, bayesdamp included. Each gets a record and three amplitudes, and replies
with the equivalent damping ratios at these amplitudes.
"""
