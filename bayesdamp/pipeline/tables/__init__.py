"""The tables of a run, from its cells."""
