"""Read measured records for which repeats provide the truth: ten runs of a rotating disc, which are not shipped."""

from __future__ import annotations

import itertools
from functools import partial
from pathlib import Path

import numpy as np

from bayesdamp.types import Refusal, Signal
from validation.contest.peers.shared import even, spectral_peak
from validation.truth.records import Case

FILE = Path("ten_runs") / "Run_1-10_no_magnet.csv"
"""Path of the file with the ten runs, below the folder of the data."""
PARTS = (5 / 6, 1 / 2, 1 / 6)
"""Amplitudes at which a run is judged, as fractions of its range of ln(amplitude) from its lowest amplitude."""
FLOOR = 0.25
"""No run is judged below this share of its first amplitude, because there it begins to stick."""
NEAR = 0.35
"""Largest difference of ln(amplitude) between an amplitude and the half cycles that give the truth there."""
LEAST = 6
"""Least number of such half cycles; with fewer, the truth at this amplitude is refused."""


def measured_records(folder: Path) -> list[Case]:
    """Return a record for each of the ten runs, with the true damping ratios. Raises Refusal if the file is missing.

    The truth at an amplitude comes from the half cycles of all other runs near this amplitude. For each two successive
    half cycles, the logarithmic decrement is ln(D1/D2), where D1 and D2 are the distances between their turning points;
    divided by π it gives the damping ratio. The truth is the value of a straight line through these ratios, in
    logarithms. It does not assume a law or an equilibrium, and uses no method of this contest.
    """
    import bayesdamp as bd

    path = folder / FILE
    if not path.is_file():
        raise Refusal(f"{FILE.name} is missing")
    signals = bd.read(path).signals()
    lost = [half_cycles(s) for s in signals]
    records = []
    for i, signal in enumerate(signals):
        others = np.concatenate([losses for j, losses in enumerate(lost) if j != i])
        high = lost[i][:, 0].max()
        low = max(lost[i][:, 0].min(), FLOOR * high)
        amplitudes = tuple(float(low * (high / low) ** part) for part in PARTS)
        ratio = partial(_line_near, others)
        records.append(
            Case(f"measured-ten_runs-{i}", "measured", signal, "", ratio=ratio, amplitudes=amplitudes)
        )
    return records


def half_cycles(signal: Signal) -> np.ndarray:
    """Return amplitude and damping ratio of each pair of successive half cycles, as columns of an array (m, 2).

    The amplitude (rad) is the geometric mean of the two half cycles' amplitudes, the ratio that of their decrement.
    """
    t, y = signal.t, signal.y
    f = spectral_peak(*even(t, y))
    turns = _turns(t, y, f)
    size = 0.5 * np.abs(np.diff(turns))
    delta = np.log(size[:-1] / size[1:]) / np.pi
    return np.column_stack([np.sqrt(size[:-1] * size[1:]), delta / np.sqrt(1 + delta**2)])


def _turns(t: np.ndarray, y: np.ndarray, f: float) -> np.ndarray:
    """Return the displacement (rad) at each turning point, from a parabola through the nearby samples.

    f: frequency in Hz.
    """
    rest = np.median(y[t >= t[-1] - 2 / f])
    side = np.sign(y - rest)
    cuts = np.flatnonzero(np.diff(side) != 0) + 1
    turns = []
    for begin, end in itertools.pairwise(cuts):
        if end - begin < 0.3 / (f * np.median(np.diff(t))):
            continue
        top = begin + int(np.argmax(np.abs(y[begin:end] - rest)))
        near = np.abs(t - t[top]) <= 0.12 / f
        c, b, a = np.polynomial.polynomial.polyfit(t[near] - t[top], y[near], 2)
        turns.append(c - b**2 / (4 * a))
    return np.array(turns)


def _line_near(lost: np.ndarray, amplitude: float) -> float:
    """Return the damping ratio at an amplitude (rad), by a straight line in logarithms through those near it.

    lost: amplitudes and damping ratios, as `half_cycles` returns them. Raises Refusal if fewer than `LEAST` are near.
    """
    away = np.log(lost[:, 0] / amplitude)
    near = np.abs(away) <= NEAR
    if near.sum() < LEAST:
        raise Refusal(f"too few half cycles of other runs near {amplitude:.3g} rad")
    return float(np.exp(np.polyfit(away[near], np.log(lost[near, 1]), 1)[1]))
