"""Detect a record that is not the free decay of one oscillator, and write the verdict on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.formatting import digits, percentage
from bayesdamp.records.oscillation.features import features, once_per_record
from bayesdamp.records.oscillation.modes import OtherMotion, find_other_motion
from bayesdamp.types import DERIVATIVES, NORMAL_95, Refusal, Signal
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import Grade, Interval, MotionKind, Oscillation, UsedWindow
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence

VISCOUS = "Each oscillation is assumed to be a sinusoid with viscous damping."


@once_per_record
def _other_motion(signal: Signal, no_law_fits: bool) -> OtherMotion | None:
    """Return the motion of a signal that is not a free decay of one oscillator; None if it may be one.

    Also None if it has no period. `no_law_fits`: whether no law of one oscillator fits the record; then smaller and
    closer second oscillations are found.
    """
    try:
        period = features(signal).period
    except Refusal:
        return None
    return find_other_motion(signal.t, signal.y, period, no_law_fits)


def no_free_decay(signal: Signal, no_law_fits: bool = False) -> Verdict | None:
    """Return the verdict on a signal that is not the free decay of one oscillator; None if it may be one.

    A search looks for other motions, such as a second oscillation or growth. The signal may be a free decay if none is
    found, or if its `size` is below `thresholds.OTHER_MOTION`: for example, the amplitude of a second oscillation
    relative to the first, or the factor of growth minus 1 (see `OtherMotion`). The limit is
    `thresholds.SMALL_OTHER_MOTION` if no law fits and two oscillations explain the record to its noise.

    Parameters
    ----------
    signal
        The signal.
    no_law_fits
        Whether no law of one oscillator fits the record; then smaller and closer second oscillations count, and those
        at a multiple of the frequency, which may also be harmonics of a nonlinear oscillator.
    """
    other = _other_motion(signal, no_law_fits)
    if other is None:
        return None
    small = no_law_fits and other.complete
    if other.size < (thresholds.SMALL_OTHER_MOTION if small else thresholds.OTHER_MOTION):
        return None
    own = other.modes
    ratios, half = own.ratios, NORMAL_95 * own.errors / (2 * np.pi * own.frequencies)
    scale = (2 * np.pi * own.frequencies) ** DERIVATIVES[signal.quantity]
    columns = np.column_stack(
        [own.frequencies, ratios, ratios - half, ratios + half, own.first / scale, own.last / scale]
    )
    modes = tuple(Oscillation(*row, unit=signal.unit) for row in columns.tolist())
    first = signal.provenance.start
    duration = float(signal.t[-1] - signal.t[0])
    spread = (modes[0].high - modes[0].low) * modes[0].frequency
    f = modes[0].frequency
    verdict = Verdict(
        signal.name,
        Grade.NO_FREE_DECAY,
        False,
        "",
        float("nan"),
        frequency=Interval(f, f - 0.5 * spread, f + 0.5 * spread, "Hz"),
        motion=MotionKind(other.kind),
        modes=modes,
        quantity=signal.quantity,
        window=UsedWindow(first, first + duration, duration * f, ""),
        remarks=() if np.isnan(own.rates).any() else (VISCOUS,),
    )
    return replace(verdict, sentence=sentence(verdict))


def remark_on(signal: Signal) -> str:
    """Return a remark on the frequency and the relative size of a second oscillation; empty if there is none.

    It does not compare the size with a limit: call it if `no_free_decay` returned None, so that the oscillation is too
    small to change the verdict.
    """
    other = _other_motion(signal, False)
    if other is None or len(other.modes.frequencies) < 2:
        return ""
    at = f"{digits(other.modes.frequencies[1])} Hz"
    return f"A second oscillation, at {at}, has {percentage(other.size)} % of the amplitude."
