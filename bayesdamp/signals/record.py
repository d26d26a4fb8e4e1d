"""What a file holds before it is cleaned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class RawRecord:
    """A record as its file has it.

    t: the file's own times in s, shape (n,), or None where a sampling rate was given instead.
    y: the recorded quantity in the file's unit, shape (n,).
    rate: the sampling rate in Hz that was given, where t is None.
    rows: row of the file that each sample stands in, counted from 0 at its first row of numbers, shape (n,).
    provenance: file, format and `notes`, sentences on what was done.
    """

    t: np.ndarray | None
    y: np.ndarray
    rate: float | None = None
    rows: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    provenance: Mapping[str, object] = field(default_factory=dict)
