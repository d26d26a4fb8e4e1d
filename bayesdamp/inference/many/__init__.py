"""Several specimens: the population of a damping coefficient."""
