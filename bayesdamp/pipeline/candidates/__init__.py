"""What is computed of one candidate on one record."""
