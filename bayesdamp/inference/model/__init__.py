"""The posterior of one model on one record: its parameters and priors, log density, gradient and Fisher information."""
