"""The tasks of one candidate (a damping sum under a restoring law) on one record."""
