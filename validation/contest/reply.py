"""The reply of a peer for a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bayesdamp.types import Refusal


@dataclass(frozen=True)
class Reply:
    """The equivalent damping ratios at the requested amplitudes.

    Attributes
    ----------
    values : tuple of float
        The ratios, largest amplitude first.
    low, high : tuple of float
        Ends of the 95 % intervals; empty without intervals.
    named : str
        The damping sum; empty if the peer does not name one outright.
    """

    values: tuple[float, ...]
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    named: str = ""


Peer = Callable[[np.ndarray, np.ndarray, tuple[float, ...]], Reply]
"""A function of times (n,) in s, displacements (n,) in rad and amplitudes in rad. Raises Refusal without an answer."""


def one_number(value: float, amplitudes: tuple[float, ...]) -> Reply:
    """Return the same ratio at every amplitude. Raises Refusal if it is not positive."""
    if not value > 0:
        raise Refusal("no damping is found")
    return Reply((value,) * len(amplitudes))
