"""Judge the answer for one record: simulated records with a known truth, repeats of measured records, and scores.

Nothing here imports the physics or the inference that it judges: the truth comes from SciPy's solver and closed forms.
"""
