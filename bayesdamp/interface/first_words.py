"""Measure frequency and damping of a record before any model is fitted, and describe them in a sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp import formatting as fmt
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.law_free import law_free
from bayesdamp.types import NORMAL_95, LawFreeDamping, Signal
from bayesdamp.units import unit_named


def first_words(signal: Signal, unit: str = "") -> LawFreeDamping:
    """Return frequency and damping of a free decay at three amplitudes, without assuming a damping law.

    The amplitudes are that in the first window of the fit (the largest), the geometric mean of first and last, and that
    in the last window (the smallest). The field `sentence` describes the result, with the mean frequency and its 95 %
    interval; its amplitudes are in `unit`, such as "deg", if this is a unit of the signal's displacement. Raises
    Refusal if the record does not oscillate or has too few cycles.

    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=10.0, samples=400, noise_sd=0.003)
    >>> bd.first_words(signal).frequency.round(2)  # Hz
    array([0.71, 0.71, 0.71])
    """
    fit = law_free(signal)
    first, last = fit.span
    at = fit.at(np.array([first, fit.halfway(), last]))
    whole = fit.at(fit.windows.times)
    mean, half = float(whole.frequency.mean()), NORMAL_95 * float(whole.frequency_sd.mean())
    begin = signal.provenance.start
    start = begin + float(signal.t[0])
    stop = begin + min(last + 0.5 * float(fit.windows.widths[-1]), float(signal.t[-1]))
    frequency = fmt.with_error(mean, half) if half < mean else f"about {fmt.digits(mean, n=2)}"
    own = unit_named(unit).displacement
    scale, name = (own.scale, own.name) if own.base == signal.unit else (1.0, signal.unit)
    ratios = [
        f"{fmt.with_error(100 * ratio, 100 * NORMAL_95 * sd)} % at {fmt.digits(scale * amplitude, n=2)} {name}"
        for amplitude, ratio, sd in np.column_stack([at.amplitude, at.ratio, at.ratio_sd]).tolist()
    ]
    middle = float(at.ratio[1])
    quality = f" (Q about {float(f'{0.5 / middle:.2g}'):g})" if middle > 0 else ""
    sentence = (
        f"It oscillates at {frequency} Hz for {features(signal).cycles:.0f} cycles ({fmt.time_span(start, stop)}); "
        f"the equivalent viscous damping ratio (95 %) is {fmt.listing(ratios)}{quality}; "
        f"{change_in_words(at)}."
    )
    return replace(at, sentence=sentence)


def change_in_words(at: LawFreeDamping) -> str:
    """Say how the damping ratio changes with the amplitude, from its values at three falling amplitudes."""
    steps = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        step, clear = at.ratio[i] - at.ratio[j], 3 * np.hypot(at.ratio_sd[i], at.ratio_sd[j])
        steps.append(step if abs(step) > max(clear, 0.1 * at.ratio[1]) else 0.0)
    early, whole, late = steps
    rise = whole or early or late
    if early * late < 0:
        return f"it is {'smallest' if late < 0 else 'largest'} at the middle amplitude"
    if rise == 0:
        return "it does not clearly change with the amplitude (as with viscous damping)"
    if rise > 0:
        return "it grows with the amplitude (as with drag)"
    return "it grows as the amplitude falls (as with dry friction)"
