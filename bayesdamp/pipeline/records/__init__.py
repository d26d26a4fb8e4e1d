"""What is computed of a record once for all candidates on it."""
