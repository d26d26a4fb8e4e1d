"""Judge the answers of bayesdamp on simulated records with a known truth, and repeat them on measured records.

The truth does not come from the package: it is computed by SciPy's solver and from closed forms.
"""
