"""How probable dampings are before a record is seen."""

from __future__ import annotations

from collections.abc import Sequence

THIRD = 0.5
"""Prior weight of a sum of three terms beside sums of one or two."""
OTHERS = 0.1
"""Prior weight of all other forms of damping together beside one sum."""


def odds(damping: Sequence[str], others: int = 0) -> float:
    """Prior weight of a damping. others: among how many forms of damping that are not compared it is one; 0 for a sum
    that is compared."""
    return (THIRD if len(damping) > 2 else 1.0) * (OTHERS / others if others else 1.0)
