"""Test the stated probabilities on simulated records.

Do 95 % intervals contain the true parameter in 95 % of the records, and is a model with the probability p the true one
in the fraction p of the records?
"""
