"""What cells hold, as values: one frozen class a kind, by which it is written and read."""
