"""Test claims of the paper on eleven damping estimators by measurements, and write a page with the verdicts."""

from bayesdamp.claims.paper import CLAIMS as CLAIMS
