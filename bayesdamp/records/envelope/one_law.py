"""A decay by one power of the amplitude above a floor: how a release is told where no straight line follows it."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from bayesdamp.physics.amplitude.laws import EXPONENTS, power_decay, power_slopes

NEPER = 20.0 / np.log(10.0)
"""dB."""
FITTED = 80
"""Blocks that a decay and its floor are fitted to."""
LEAST_DROP = 3.0
"""dB that a decay has to fall for its rate to be told; a half-life is 6."""
LEAST_POINTS = 6
WORSE = 2.0
"""Times the usual misfit of a short line at which it is none of the decay."""
GUARD = 0.02
"""Share of the decay's duration left out after the release where a drive stands before it."""
CHECKED = 0.05
"""Share of a decay, at its start, that a law must hold for by itself."""
WON = 0.15
"""Share of a decay's duration, or of its fall in dB, by which it must be longer to begin where a law begins and not
where a straight line does."""
SMALLEST = 0.15
"""dB that is no deviation: detectors are not linear to better."""


def blocks(t: np.ndarray, y: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means of times and values over at most so many runs of samples, and the runs' bounds, shape (blocks + 1,)."""
    count = min(most, t.size)
    edges = np.linspace(0, t.size, count + 1).round().astype(int)
    size = np.diff(edges)
    return np.add.reduceat(t, edges[:-1]) / size, np.add.reduceat(y, edges[:-1]) / size, edges


def fall(y: np.ndarray, begin: int, end: int) -> float:
    """dB from the first twentieth to the last."""
    if end - begin < 2:
        return 0.0
    part = max(1, (end - begin) // 20)
    return float(y[begin : begin + part].mean() - y[end - part : end].mean())


def start_by_a_law(
    t: np.ndarray, y: np.ndarray, tb: np.ndarray, yb: np.ndarray, edges: np.ndarray, begin: int, end: int
) -> int:
    """The block from which one power of the amplitude, and a floor, describe the level to the end.

    Straight lines follow a decay back only as long as it is straight: dry friction bends it in dB, and drag. By halving
    among the blocks before the one they led to; kept where little is won.
    """

    low, found = -1, begin
    while found - low > 1:
        middle = (low + found) // 2
        holds = a_law_holds(t, y, tb, yb, edges, middle)
        low, found = (low, middle) if holds else (middle, found)
    span, whole = max(end - found, 1), fall(yb, found, end)
    won = whole - fall(yb, begin, end)
    if won < LEAST_DROP or (begin - found < WON * span and won < WON * whole):
        return begin
    return found + (max(1, round(GUARD * span)) if found > 0 else 0)


def a_law_holds(
    t: np.ndarray, y: np.ndarray, tb: np.ndarray, yb: np.ndarray, edges: np.ndarray, at: int
) -> bool:
    """Whether one power of the amplitude, and a floor, describe the level from a block on, and just behind it."""
    x, floor, seen, _, scale = one_law(t, y, at, tb, edges)
    x = x[: max(seen - at, LEAST_POINTS)]
    off = yb[at : at + x.size] - scale - 10.0 * np.log10(np.exp(2.0 * x) + floor)
    z = off / np.hypot(SMALLEST, NEPER * np.sqrt(0.5 * floor) * np.exp(-x))
    first = z[: max(LEAST_POINTS, round(CHECKED * z.size))]
    return bool(max(np.mean(z**2), np.mean(first**2)) <= WORSE**2)


def one_law(
    t: np.ndarray, y: np.ndarray, begin: int, tb: np.ndarray, edges: np.ndarray
) -> tuple[np.ndarray, float, int, int, float]:
    """A power of the amplitude and a floor from a block on: x at the blocks, the floor's power, the block from which it
    is seen, the reading up to which both were fitted, and the level in dB that these are relative to."""
    count = tb.size
    start = int(edges[begin])
    scale = float(y[start:].max())
    stop = y.size
    x, seen, floor, found = np.zeros(0), count, 0.0, None
    for _ in range(2):
        tc, power, _ = blocks(t[start:stop], 10.0 ** ((y[start:stop] - scale) / 10.0), FITTED)
        found = _decay_and_floor(tc - t[start], power, found)
        times = tb[begin:] - t[start]
        x = power_decay(times, found[0], found[1] - (found[2] - 1.0) * found[0], found[2])
        floor = float(np.exp(found[3]))
        reached = np.flatnonzero(np.exp(2.0 * x) < floor)
        if not reached.size:
            break
        # What the floor does long after is not what it does to the decay.
        seen = begin + int(reached[0])
        stop = int(np.searchsorted(t, t[start] + 2.0 * float(times[reached[0]])))
        stop = min(max(stop, start + LEAST_POINTS), y.size)
        if stop >= y.size:
            break
    return x, floor, seen, stop, scale


def _decay_and_floor(t: np.ndarray, power: np.ndarray, begin: np.ndarray | None) -> np.ndarray:
    """ln of the amplitude at the start, ln of the rate there, the exponent, and ln of the floor's power."""
    level = 5.0 * np.log(power)
    tail = float(np.median(power[-max(2, power.size // 8) :]))
    x0 = 0.5 * float(np.log(power[:3].mean()))
    fallen = np.flatnonzero(0.5 * np.log(power) < 0.5 * (x0 + 0.5 * np.log(tail)))
    half = float(t[fallen[0]]) if fallen.size and fallen[0] > 0 else float(t[-1])
    depth = max(0.5 * (x0 - 0.5 * np.log(tail)), 0.05)
    # A tolerance of 0.3 dB, and of what a floor of random phase does to a level.
    width = np.hypot(0.3, 5.0 * np.sqrt(0.5 * tail / np.maximum(power, tail)))

    def signal(p: np.ndarray) -> np.ndarray:
        return np.exp(2.0 * power_decay(t, p[0], p[1] - (p[2] - 1.0) * p[0], p[2]))

    def off(p: np.ndarray) -> np.ndarray:
        return (5.0 * np.log(signal(p) + np.exp(p[3])) - level) / width

    def slopes(p: np.ndarray) -> np.ndarray:
        seen, floor = signal(p), np.exp(p[3])
        columns = np.column_stack([2.0 * seen[:, None] * power_slopes(t, p), np.full(t.size, floor)])
        return columns * (5.0 / ((seen + floor) * width))[:, None]

    low, high = [-30.0, -60.0, EXPONENTS[0], -80.0], [10.0, 60.0, EXPONENTS[1], 1.0]
    starts = [] if begin is None else [begin]
    for exponent in (1.0, 0.2, 1.8) if begin is None else ():
        # The rate at the start with which this law falls by `depth` in the time `half`.
        q = exponent - 1.0
        rate = depth if q == 0.0 else np.expm1(q * depth) / q
        starts.append(np.array([x0, np.log(rate / max(half, 1e-300)), exponent, np.log(tail)]))
    found = [
        least_squares(
            off,
            np.clip(p, low, high),
            slopes,  # type: ignore[arg-type]
            bounds=(low, high),
            loss="soft_l1",
            max_nfev=25,
            x_scale=[1.0, 1.0, 0.3, 1.0],
        )
        for p in starts
    ]
    return min(found, key=lambda one: one.cost).x
