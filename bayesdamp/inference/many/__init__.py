"""Several records: a joint posterior, its evidence, and a population of specimens."""
