"""Judge the answers of bayesdamp: simulated records with a known truth, repeats of measured records, and scores.

The truth does not come from the package: it is computed by SciPy's solver and from closed forms.
"""
