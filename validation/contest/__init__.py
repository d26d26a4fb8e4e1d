"""Compare bayesdamp with an engineer's script on the same records: `python -m validation.contest`.

A peer is one of the methods that take part, bayesdamp included. Each peer gets a record and three amplitudes, and
answers with the equivalent damping ratios at these amplitudes.
"""
