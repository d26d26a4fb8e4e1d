"""What tests read from a weighed sum."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.envelope.candidates import EnvelopeCandidate


def place_as_given(candidate: EnvelopeCandidate) -> int:
    """Return the place of the combination of no deviation and the noise as given: its factors are exp(-0.25), 1,
    exp(0.25)."""
    return int(np.flatnonzero(candidate.about.size == 0.0)[1])


def log_evidence_as_given(candidate: EnvelopeCandidate) -> float:
    """Return the log evidence there, without the prior probability: 0.8 of no deviation, a third of the factor."""
    own = candidate.weighed.combos == place_as_given(candidate)
    log = float(np.logaddexp.reduce(candidate.weighed.log_each[own]))
    return log - float(np.log(0.8)) + float(np.log(3.0))
