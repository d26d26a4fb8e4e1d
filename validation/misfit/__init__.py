"""Test whether answers are right, or give a warning, on records that no law fits and on records of poor quality.

The family consists of the sums of viscous, Coulomb and quadratic damping with the restoring laws of bayesdamp.
"""
