"""The posterior of one model on one record: parameters and priors, log density, gradient and information."""
