"""Compute the tasks on one candidate (a damping sum under a restoring law): estimates, mode, posteriors, evidence."""
