"""Compute the tasks on one candidate: estimates, mode, posteriors, evidence.

A candidate is a sum of damping terms under a restoring law.
"""
