"""The free decay of an envelope: its window, its readings in blocks, and their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bayesdamp.inference.envelope.candidates import Blocks
from bayesdamp.inference.envelope.decay import Decay
from bayesdamp.inference.envelope.noises import noises
from bayesdamp.inference.envelope.release import held_blocks
from bayesdamp.inference.envelope.sums import Sum, sums_on
from bayesdamp.physics.amplitude.laws import SUMS
from bayesdamp.records.envelope.floor import ABOVE_FLOOR
from bayesdamp.records.envelope.one_law import LEAST_DROP, NEPER, blocks
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.records.envelope.window import Window, find_window
from bayesdamp.types import Refusal

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
        from bayesdamp.records.envelope.scale import scale_of

        scale = scale_of(record, sums, start + reference)
    return sums_on(sums, scale, start, float(b.x.min()))
