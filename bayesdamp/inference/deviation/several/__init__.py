"""Several records of one specimen, joined in the likelihoods of their damping."""
