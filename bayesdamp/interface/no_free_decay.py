"""Detect a record that is not a free decay of one oscillator, and decide on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.records.oscillation.features import features, once_per_record
from bayesdamp.records.oscillation.modes import OtherMotion, find_other_motion
from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import Grade, Interval, MotionKind, Oscillation, UsedWindow
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence

ORDER = {"angle": 0, "velocity": 1, "acceleration": 2}
TWO_SIDED = 1.96
VISCOUS = "Each oscillation is assumed to be a sinusoid with viscous damping."


@once_per_record
def _other_motion(signal: Signal, harmonics: bool) -> OtherMotion | None:
    """Return what a signal is if not the free decay of one oscillator; None where it may be one."""
    try:
        period = features(signal).period
    except Refusal:
        return None
    return find_other_motion(signal.t, signal.y, period, harmonics)


def no_free_decay(signal: Signal, harmonics: bool = False) -> Verdict | None:
    """Return the verdict on a signal with another motion that is large enough; None for a free decay.

    Parameters
    ----------
    signal
        The signal.
    harmonics
        Whether a second oscillation at a whole multiple of the frequency counts; where the law of one oscillator
        agrees with the record, it may be its harmonic.
    """
    other = _other_motion(signal, harmonics)
    if other is None or other.size < thresholds.OTHER_MOTION:
        return None
    own = other.modes
    ratios, half = own.ratios, TWO_SIDED * own.errors / (2 * np.pi * own.frequencies)
    scale = (2 * np.pi * own.frequencies) ** ORDER[signal.quantity]
    columns = np.column_stack(
        [own.frequencies, ratios, ratios - half, ratios + half, own.first / scale, own.last / scale]
    )
    modes = tuple(
        Oscillation(f, r, low, high, a, b, signal.unit) for f, r, low, high, a, b in columns.tolist()
    )
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
    """Return a remark on a second oscillation that is too small for another verdict; empty where there is none."""
    other = _other_motion(signal, False)
    if other is None or len(other.modes.frequencies) < 2:
        return ""
    at = f"{other.modes.frequencies[1]:.4g} Hz"
    return f"A second oscillation, at {at}, has {100 * other.size:.2g} % of the amplitude."
