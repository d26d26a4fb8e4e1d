"""Prior odds of damping models, the same for oscillations and for envelopes."""

from __future__ import annotations

from collections.abc import Sequence

FURTHER_TERM = 0.125
"""Factor of a model's prior probability for each term beyond the first. Chosen on 82 simulated records with a damping
ratio of 0.01 (three sevenths of them single terms, three sums of two, one of three): with it nearly as many are
decided, and as many rightly, as under half-normal priors of one fixed scale of 0.1."""
OTHERS = 0.1
"""Prior weight of all other forms of damping together beside one sum."""


def odds(damping: Sequence[str], others: int = 0) -> float:
    """Prior odds of a damping against a single term.

    Parameters
    ----------
    damping
        Its terms.
    others
        Number of the forms of damping that are not compared and of which it is one; 0 for a sum that is compared.
    """
    return FURTHER_TERM ** (len(damping) - 1) * (OTHERS / others if others else 1.0)
