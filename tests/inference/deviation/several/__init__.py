"""Several records of one specimen."""
