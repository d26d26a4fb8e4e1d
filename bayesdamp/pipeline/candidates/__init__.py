"""The tasks of one candidate on one record."""
