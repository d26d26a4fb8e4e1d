"""Methods for the evidence: one class in one module each, found by name."""
