"""What a file holds before it is cleaned."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bayesdamp.provenance import Provenance


@dataclass(frozen=True)
class RawRecord:
    """A record as its file has it.

    t: the file's own times in s, shape (n,), or None where a sampling rate was given instead.
    y: the recorded quantity in the file's unit, shape (n,).
    rate: the sampling rate in Hz that was given or that the file says, where t is None.
    rows: row of the file that each sample stands in, counted from 0 at its first row of numbers, shape (n,).
    provenance: how it was read.
    run: the file's own label of the run, channel: the column's name without it; empty where the file has none.
    unit: the displacement's unit in UNITS that the file or the caller says, else as the file writes it, empty where
    nobody says. quantity: "angle", "velocity", "acceleration", or empty where nobody says.
    columns: what to ask for to get these columns again: (times or None, values), by name or number from 1.
    repeat: whether the file says that it is one of several runs of one thing. choice: the sentence on the choice among
    the file's columns, empty where there was none. why: those of the notes that say where times and values are.
    began: the file's time in s of the first sample, where it counts from an epoch and t from that sample; else 0.
    """

    t: np.ndarray | None
    y: np.ndarray
    rate: float | None = None
    rows: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    provenance: Provenance = field(default_factory=Provenance)
    run: str = ""
    channel: str = ""
    unit: str = ""
    quantity: str = ""
    columns: tuple[str | int | None, str | int | None] = (None, None)
    repeat: bool = False
    choice: str = ""
    why: tuple[str, ...] = ()
    began: float = 0.0
