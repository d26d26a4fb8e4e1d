"""A record as a short sequence: the amplitude of its oscillation, stretch by stretch of its phase."""

from __future__ import annotations

import numpy as np

from bayesdamp.estimators.networks.record import Phase
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Refusal, Signal

LEAST_SAMPLES = 5
LEAST_STRETCHES = 3
FEW = 6.0
"""Fewer half-cycles are cut into quarter cycles."""


class Stretches:
    """Stretches of half a cycle of the record's phase φ; of several where there were more than `most`, of a quarter
    where there are few.

    In each, y = a cos φ + b sin φ about the record's midline, and about each stretch's own where that is half a cycle
    or more, by least squares. The same matrices serve for any record at these times.
    count: stretches that have enough samples. half_cycles: in a stretch.
    """

    def __init__(self, signal: Signal, seen: Features, t: np.ndarray, most: int) -> None:
        phase = Phase(signal, seen).jet(t)[0]
        total = (phase[-1] - phase[0]) / np.pi
        self.half_cycles = float(max(1, np.ceil(total / most))) if total >= FEW else 0.5
        self.rest = seen.rest
        index = ((phase - phase[0]) / (np.pi * self.half_cycles)).astype(int)
        self.rows, self.solve, self.spread = [], [], []
        for i in range(index[-1] + 1):
            rows = np.flatnonzero(index == i)
            if rows.size < LEAST_SAMPLES or np.ptp(phase[rows]) < 0.6 * np.pi * self.half_cycles:
                continue
            columns = np.stack([np.cos(phase[rows]), np.sin(phase[rows]), np.ones(rows.size)], axis=1)
            solve = np.linalg.pinv(columns[:, : 3 if self.half_cycles >= 1 else 2])[:2]
            self.rows.append(rows)
            self.solve.append(solve)
            self.spread.append(np.linalg.cholesky(solve @ solve.T))
        self.count = len(self.rows)
        if self.count < LEAST_STRETCHES:
            raise Refusal(
                f"{self.count} stretches of the record have enough samples, and at least {LEAST_STRETCHES} are needed"
            )

    def quadratures(self, y: np.ndarray) -> np.ndarray:
        """(a, b) of records y (m, n), each stretch's, (m, count, 2)."""
        y = y - self.rest
        return np.stack([y[:, rows] @ solve.T for rows, solve in zip(self.rows, self.solve)], axis=1)

    def noise(self, shape: int, rng: np.random.Generator) -> np.ndarray:
        """What white noise of standard deviation 1 in `shape` records does to (a, b), (shape, count, 2)."""
        white = rng.standard_normal((shape, self.count, 2))
        return np.einsum("kij,mkj->mki", np.array(self.spread), white)
