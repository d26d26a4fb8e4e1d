"""Define the reply of a peer, and the common code of the peers: equilibrium, frequency, even sampling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bayesdamp.types import Refusal

GAP = 1.5
"""Two samples that are more than this many median steps apart have a gap between them."""


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


def about_rest(t: np.ndarray, y: np.ndarray, f: float) -> np.ndarray:
    """Return the displacement from the rest position, which is the mean of the last whole cycles, at most five.

    Raises Refusal if the record is shorter than a cycle.

    Parameters
    ----------
    t, y : (n,) arrays
        Evenly sampled times in s, and displacements in rad.
    f : float
        Frequency in Hz.
    """
    cycles = min(int((t[-1] - t[0]) * f), 5)
    if cycles < 1:
        raise Refusal("less than one cycle")
    return y - y[t >= t[-1] - cycles / f].mean()


def segments(t: np.ndarray, y: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return times and displacements of each piece of a record between its gaps."""
    cuts = np.flatnonzero(np.diff(t) > GAP * np.median(np.diff(t))) + 1
    return list(zip(np.split(t, cuts), np.split(y, cuts), strict=True))


def is_recorded(grid: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return which times of an even grid are within a step of a sample, booleans of the shape of the grid."""
    after = np.clip(np.searchsorted(t, grid), 1, t.size - 1)
    nearest = np.minimum(np.abs(grid - t[after - 1]), np.abs(grid - t[after]))
    return nearest <= np.median(np.diff(t))
