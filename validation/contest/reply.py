"""What a peer says of a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bayesdamp.types import Refusal


@dataclass(frozen=True)
class Reply:
    """Equivalent damping ratios at the amplitudes that were asked for, largest amplitude first.

    low, high: ends of stated 95 % intervals, empty where none is stated. named: the damping sum, empty where none is
    named without reservation.
    """

    values: tuple[float, ...]
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    named: str = ""


Peer = Callable[[np.ndarray, np.ndarray, tuple[float, ...]], Reply]
"""From times (n,) in s, displacements (n,) in rad and amplitudes in rad. Raises Refusal where it has no answer."""


def one_number(value: float, amplitudes: tuple[float, ...]) -> Reply:
    """The same ratio at every amplitude. Raises Refusal where it is no damping."""
    if not value > 0:
        raise Refusal("no damping is found")
    return Reply((value,) * len(amplitudes))
