"""Test claims of the paper on eleven damping estimators by measurements, and write a page with the verdicts."""

from bayesdamp.claims import accuracy, mechanisms
from bayesdamp.claims.judge import Claim

CLAIMS: tuple[Claim, ...] = (*mechanisms.CLAIMS, *accuracy.CLAIMS)
"""All claims of the paper that are judged, in the order of the page: mechanisms, errors on records without noise,
errors on noisy records, times."""
