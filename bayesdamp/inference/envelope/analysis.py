"""The free decay of an envelope: its window, its readings in blocks, and their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from bayesdamp.inference.envelope.candidates import Blocks, fit_rates
from bayesdamp.inference.envelope.decay import Decay
from bayesdamp.inference.envelope.noises import noises
from bayesdamp.inference.envelope.sums import Sum, sums_on
from bayesdamp.physics.amplitude.laws import EXPONENTS, SUMS, ClosedForm, power_decay, power_slopes
from bayesdamp.records.envelope.decay import ABOVE_FLOOR
from bayesdamp.records.envelope.decay import LEAST_DROP, NEPER, blocks
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.records.envelope.window import Window, find_window
from bayesdamp.types import Refusal

FEWEST = 30
"""Blocks from which on it is looked for."""
FIRST, EACH = 2, 3
"""Blocks that are tried: from FIRST on to half of all, every so many."""
BETTER = 0.75
"""Share of the misfit of a decay from the start on that a held level before it has to leave at most."""
LEAST = 0.02
"""Scatter of ln A at least, a percentage that laws and detectors are off."""


def held_blocks(b: Blocks) -> int:
    """How many blocks at the start are a drive's: the level stands there and decays from then on by the sum of all
    three dampings, which fits much better than these, or rising friction, from the start on; 0 where it does not."""
    n = b.t.size
    if n < FEWEST:
        return 0
    seen = np.sqrt(b.floor.power) if b.floor is not None else 0.0
    inverse = np.diag(1.0 / np.maximum(LEAST, np.exp(-b.x) * seen))

    law = ClosedForm(SUMS[-1])

    rates: np.ndarray | None = None

    def misfit(held: int) -> float:
        nonlocal rates
        found = fit_rates(replace(b, t=np.maximum(b.t - b.t[held], 0.0)), law, inverse, rates)
        rates = np.maximum(found.values[:-1], 1e-3 * b.mean_rate)  # the next fit is near
        return found.squares

    tried = range(FIRST, n // 2, EACH)
    left = [misfit(held) for held in tried]
    best = int(np.argmin(left))
    better = left[best] < BETTER * misfit(0) and left[best] < BETTER * _by_rising_friction(b, inverse)
    return tried[best] + 1 if better else 0


def _by_rising_friction(b: Blocks, inverse: np.ndarray) -> float:
    """Misfit of a decay from the start on by one power of the amplitude below 0: friction that rises towards rest stays
    long and then falls fast, as a held level does, and no sum of the three dampings describes it."""

    def off(p: np.ndarray) -> np.ndarray:
        return inverse @ (b.x - power_decay(b.t, p[0], p[1] - (p[2] - 1.0) * p[0], p[2]))

    def slopes(p: np.ndarray) -> np.ndarray:
        return -inverse @ power_slopes(b.t, p)

    steepest, top = EXPONENTS[0], b.ends[0]
    q = 0.5 * steepest - 1.0
    rate = np.expm1(q * (top - b.ends[1])) / (q * b.duration)  # which falls by as much in the time
    begin = np.array([top, np.log(rate), q + 1.0])
    bounds = np.array([-np.inf, -np.inf, steepest]), np.array([np.inf, np.inf, 0.0])
    found = least_squares(off, begin, slopes, bounds=bounds, x_scale=[1.0, 1.0, 0.3], max_nfev=60)  # type: ignore[arg-type]
    return 2.0 * float(found.cost)


MOST = 100
"""Means of readings that are weighed: enough for what a decay of 40 dB and its noise are made of."""
TRIES = 3
SHORTER = 0.05
"""Share of a decay by which one of which no floor is seen has to be shorter to be cut where its scatter shows one."""
SPARSE = 40
"""Readings below which none is left out for standing off."""


def free_decay(
    record: EnvelopeRecord, window: Window | None, sums: Sequence[tuple[str, ...]]
) -> tuple[Decay, tuple[Sum, ...]]:
    """The decay where its noise shows it to be, and the sums on it. Raises Refusal where the level does not fall."""
    chosen = window or find_window(record.t, record.level)
    first, stop = chosen.start, chosen.stop
    found, reference = _blocks(record, chosen, first)
    for _ in range(TRIES):
        held = held_blocks(found) if window is None and stop - first >= SPARSE else 0
        if held == 0:
            break
        first += held * (stop - first) // found.t.size
        found, reference = _blocks(record, chosen, first)
    asked = _sums(record, sums, found, reference)
    found, readings, inverse, later, end = noises(found, asked)
    for _ in range(TRIES):
        if window is not None or chosen.stop - first < SPARSE:
            break
        size = chosen.stop - first
        behind = first + end * size // found.t.size
        if later == 0 and (chosen.floor is not None or size - (behind - first) < SHORTER * size):
            break
        if behind - first < SPARSE or later > 0:
            behind = chosen.stop
        first += later * size // found.t.size
        chosen = replace(chosen, stop=behind)
        found, reference = _blocks(record, chosen, first)
        asked = _sums(record, sums, found, reference)
        found, readings, inverse, later, end = noises(found, asked)
    if chosen.stop < stop:
        last = f"{record.t[chosen.stop - 1]:.4g} s"
        ends = f"ends at {last}, {ABOVE_FLOOR:g} dB above the noise floor that its scatter shows"
        chosen = replace(chosen, why=(chosen.why[0], ends))
    return Decay(record, chosen, first, found, reference, readings, inverse), asked


def _blocks(record: EnvelopeRecord, window: Window, first: int) -> tuple[Blocks, float]:
    """The decay in blocks, and ln of its reference amplitude (the middle of the fall in dB, as a level's ln).

    Raises Refusal where it falls too little for its rate to be told.
    """
    t, x, _ = blocks(record.t[first : window.stop], record.level[first : window.stop] / NEPER, MOST)
    edge = max(1, t.size // 30)
    top, bottom = x[:edge].mean(), x[-edge:].mean()
    drop = NEPER * float(top - bottom)
    if not drop >= LEAST_DROP:
        raise Refusal(
            f"between {record.t[first]:.4g} and {record.t[window.stop - 1]:.4g} s the level falls by "
            f"{max(drop, 0.0):.1f} dB, {LEAST_DROP:g} are needed"
        )
    reference = 0.5 * float(top + bottom)
    duration = float(t[-1] - t[0])
    floor = None if window.floor is None else window.floor.scaled(np.exp(-2.0 * reference))
    mean_rate = float(top - bottom) / (duration * (1.0 - edge / t.size))
    each = (window.stop - first) / t.size
    frequency = 2.0 * np.pi * record.frequency if record.frequency else None
    return Blocks(t - t[0], x - reference, duration, mean_rate, floor, each, frequency), reference


def _sums(
    record: EnvelopeRecord, sums: Sequence[tuple[str, ...]], b: Blocks, reference: float
) -> tuple[Sum, ...]:
    """On this decay; its start is what terms' parameters are relative to."""
    start = b.ends[0]
    scale = None
    if tuple(sums) != SUMS:
        from bayesdamp.records.envelope.record import scale_of

        scale = scale_of(record, sums, start + reference)
    return sums_on(sums, scale, start, float(b.x.min()))
