"""Detect a record that is not the free decay of one oscillator, and write the verdict on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.records.oscillation.features import features, once_per_record
from bayesdamp.records.oscillation.modes import OtherMotion, find_other_motion
from bayesdamp.types import NORMAL_95, Refusal, Signal
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import Grade, Interval, MotionKind, Oscillation, UsedWindow
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence

DERIVATIVES = {"angle": 0, "velocity": 1, "acceleration": 2}
"""Number of time derivatives of the displacement in each recorded quantity."""
VISCOUS = "Each oscillation is assumed to be a sinusoid with viscous damping."


@once_per_record
def _other_motion(signal: Signal, harmonics: bool) -> OtherMotion | None:
    """Return the motion of a signal that is not a free decay of one oscillator; None if it may be one.

    Also None if it has no period. `harmonics` is as in `no_free_decay`.
    """
    try:
        period = features(signal).period
    except Refusal:
        return None
    return find_other_motion(signal.t, signal.y, period, harmonics)


def no_free_decay(signal: Signal, harmonics: bool = False) -> Verdict | None:
    """Return the verdict on a signal that is not the free decay of one oscillator; None if it may be one.

    It may be one if no other motion is found, or if its size is below `thresholds.OTHER_MOTION`.

    Parameters
    ----------
    signal
        The signal.
    harmonics
        Whether an oscillation at a multiple of the frequency counts as a second oscillation. It may also be a harmonic
        of a nonlinear oscillator, so use True only if no law of one oscillator fits the record.
    """
    other = _other_motion(signal, harmonics)
    if other is None or other.size < thresholds.OTHER_MOTION:
        return None
    own = other.modes
    ratios, half = own.ratios, NORMAL_95 * own.errors / (2 * np.pi * own.frequencies)
    scale = (2 * np.pi * own.frequencies) ** DERIVATIVES[signal.quantity]
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
    """Return a remark on a second oscillation that is too small to change the verdict; empty if there is none."""
    other = _other_motion(signal, False)
    if other is None or len(other.modes.frequencies) < 2:
        return ""
    at = f"{other.modes.frequencies[1]:.4g} Hz"
    return f"A second oscillation, at {at}, has {100 * other.size:.2g} % of the amplitude."
