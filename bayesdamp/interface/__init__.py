"""The interface in Python: what `bayesdamp` hands out, over what the other packages compute.

One public function or class a file; `records` has those of records, `fitting` what fits a model
to one, `parts` what all share. Nothing in the package imports this one.
"""
