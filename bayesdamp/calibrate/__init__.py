"""Test the stated probabilities on simulated records.

For parameters: do 95 % intervals contain the true value in 95 % of the records? For models: if a model has the
probability p, is it the true one in the fraction p of the records?
"""
