"""The pieces of a record: at rest, held or pushed by a hand, decaying freely, sticking, lost in the noise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from bayesdamp.provenance import Kind, Piece

STILL = 0.02
"""Share of the amplitude that a record at rest may move by within a quarter of a period."""
NEAR = 0.15
"""Share of the amplitude within which a level is that of the rest."""
SLOW = 0.25
"""Share of the oscillation's peak velocity below which a hand holds or tilts, and above which it pushes."""


WHY: dict[Kind, str] = {
    "at rest": "It stays at the level about which the oscillation swings.",
    "held": "It stays, or moves slowly, away from the level about which the oscillation swings.",
    "pushed": "It moves, but not as the free decay would.",
}


def pieces_before(
    t: np.ndarray, y: np.ndarray, period: float, amplitude: float, midline: float, floor: float
) -> list[Piece]:
    """Return what comes before a free decay, or between two: smoothed samples y (n,) at times t (n,).

    period (s), amplitude and midline are those of the decay, floor is the smallest change that tells something (both in
    the unit of the record).
    """
    if t.size < 2:
        return []
    quarter = max(round(0.25 * period / float((t[-1] - t[0]) / (t.size - 1))), 1)
    moved = np.abs(y[np.minimum(np.arange(t.size) + quarter, t.size - 1)] - y)
    limit = max(STILL * amplitude, floor)
    slow = max(SLOW * np.pi / 2 * amplitude, limit)
    kinds = np.where(moved <= limit, 0, np.where(moved <= slow, 1, 2))
    kinds[max(t.size - quarter, 0) :] = kinds[max(t.size - quarter - 1, 0)]
    at_rest = (kinds == 0) & (np.abs(y - midline) <= NEAR * amplitude + floor)
    order: tuple[Kind, ...] = ("at rest", "held", "pushed")
    which = np.where(at_rest, 0, np.where(kinds < 2, 1, 2))
    edges = [0, *(np.flatnonzero(np.diff(which)) + 1).tolist(), t.size]
    parts = [(a, b, order[which[a]]) for a, b in pairwise(edges)]
    merged: list[tuple[int, int, Kind]] = []
    for a, b, kind in parts:  # what is shorter than a third of a period belongs to its neighbour
        if merged and (kind == merged[-1][2] or b - a < 4 * quarter / 3):
            merged[-1] = (merged[-1][0], b, merged[-1][2])
        else:
            merged.append((a, b, kind))
    if len(merged) > 1 and merged[0][1] - merged[0][0] < 4 * quarter / 3:
        merged[:2] = [(0, merged[1][1], merged[1][2])]
    return [Piece(float(t[a]), float(t[min(b, t.size - 1)]), kind, WHY[kind]) for a, b, kind in merged]
