"""Stand-ins for the forces of an oscillator, which `build` writes in their place."""

from __future__ import annotations

import numpy as np
from numba import njit

from bayesdamp.physics.damping import EXACT, TINY

__all__ = [
    "EXACT", "JUMPS", "LAW_SIZES", "OWNERS", "SWITCHES", "TINY", "damping", "damping_slopes", "gathered",
    "restoring", "restoring_slopes", "shapes",
]  # fmt: skip

OWNERS = np.array([0], np.int64)
"""Of each further parameter, the term's number."""
SWITCHES = np.array([False])
"""Of each term, whether its force turns over within ε where the velocity does."""
LAW_SIZES = np.array([1], np.int64)
"""How many parameters each restoring law has."""
JUMPS = np.array([False])
"""Of each term, whether that is a jump where ε is 0, and not a shape that is rounded off."""


@njit
def shapes(x, v, epsilon, rounding, q, active, out):
    """Compute the forces per unit of the coefficients at one point.

    rounding: the ε of terms that are rounded off; q: the terms' further parameters, one after the other.
    """
    out[:] = 0.0


@njit
def damping(x, v, epsilon, rounding, q, c):
    """Compute the force of all terms at one point; a term with coefficient 0 costs nothing."""
    return 0.0


@njit
def damping_slopes(x, v, epsilon, rounding, q, c, active, sizes, share, out):
    """Compute the force of all terms at one point and its slopes by x and v.

    Into `out`, from its third place on, go each term's force per unit and the slopes of the whole by the further
    parameters, times share.
    """
    return 0.0, 0.0, 0.0


@njit
def gathered(coefficients, q, active, law):
    """Return coefficients, further parameters and the law's as tuples, which need no reference counts.

    Coefficients of terms that do not act are 0. Behind the coefficients: 1 where a term acts that is not among the
    first `build.USUAL`, else 0.
    """
    return (coefficients[0],), (0.0,), (law[0], law[1])


@njit
def restoring(x, p):
    """Compute the restoring force at one point. p: the law's parameters, then its number."""
    return p[0] * x


@njit
def restoring_slopes(x, p, sizes, share, out, first):
    """Compute the restoring force at one point and its slope by x.

    Slopes by the law's parameters, times share, go into `out` from `first` on.
    """
    out[first] = share * x
    return p[0] * x, p[0]
