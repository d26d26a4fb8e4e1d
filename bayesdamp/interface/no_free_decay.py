"""The verdict on a record that is no free decay of one oscillator."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.modes import NotOne, other_than_one
from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import Grade, Interval, Mode, Motion, Window
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence

ORDER = {"angle": 0, "velocity": 1, "acceleration": 2}
TWO_SIDED = 1.96
VISCOUS = "Each oscillation is taken as a sinusoid with viscous damping."


@lru_cache(maxsize=8)
def seen_in(signal: Signal, harmonics: bool = False) -> NotOne | None:
    """What a signal is if not the free decay of one oscillator; None where it may be one."""
    try:
        period = features(signal).period
    except Refusal:
        return None
    return other_than_one(signal.t, signal.y, period, harmonics)


def no_free_decay(signal: Signal, harmonics: bool = False) -> Verdict | None:
    """Return the verdict on a signal in which something else is seen that is large enough; None elsewhere.

    harmonics: whether a second oscillation at a whole multiple of the frequency counts, which may be one oscillator's
    harmonic where its law agrees with the record.
    """
    found = seen_in(signal, harmonics)
    if found is None or found.size < thresholds.OTHER_MOTION:
        return None
    own = found.modes
    ratios, half = own.ratios, TWO_SIDED * own.errors / (2 * np.pi * own.frequencies)
    scale = (2 * np.pi * own.frequencies) ** ORDER[signal.quantity]
    columns = np.column_stack(
        [own.frequencies, ratios, ratios - half, ratios + half, own.first / scale, own.last / scale]
    )
    modes = tuple(Mode(f, r, low, high, a, b, signal.unit) for f, r, low, high, a, b in columns.tolist())
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
        motion=Motion(found.seen),
        modes=modes,
        quantity=signal.quantity,
        window=Window(first, first + duration, duration * f, ""),
        remarks=() if np.isnan(found.modes.rates).any() else (VISCOUS,),
    )
    return replace(verdict, sentence=sentence(verdict))


def remark_on(signal: Signal) -> str:
    """A remark on a second oscillation that is too small to matter much; empty where there is none."""
    found = seen_in(signal)
    if found is None or len(found.modes.frequencies) < 2:
        return ""
    at = f"{found.modes.frequencies[1]:.4g} Hz"
    return f"A second oscillation, at {at}, has {100 * found.size:.2g} % of the amplitude."
