"""The interface in Python: what `bayesdamp` hands out, over what the other packages compute.

One public function or class a file; `parts` holds what they share. Nothing in the package imports this one.
"""
