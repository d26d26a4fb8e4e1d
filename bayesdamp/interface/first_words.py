"""Describe a record before any model is fitted: its frequency and damping, or why it is not a free decay."""

from dataclasses import replace

import numpy as np

from bayesdamp import formatting as fmt
from bayesdamp.records.oscillation.features import features, once_per_record
from bayesdamp.records.oscillation.law_free import law_free
from bayesdamp.records.oscillation.modes import MOST_MISFIT, OtherMotion, find_other_motion
from bayesdamp.types import DERIVATIVES, NORMAL_95, LawFreeDamping, Refusal, Signal, unit_named
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import Grade, Interval, MotionKind, Oscillation, UsedWindow
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence


def first_words(signal: Signal, unit: str = "") -> LawFreeDamping:
    """Measure frequency and damping of a free decay at three amplitudes, without assuming a damping law.

    Sinusoids are fitted in short windows. The arrays of the result, a `LawFreeDamping`, have three elements, for the
    amplitude in the first window (the largest), the geometric mean of this and the last one, and that in the last
    window (the smallest), in the signal's base unit. The field `sentence` of the result describes it, with the mean
    frequency and its 95 % interval. Only in this sentence are the amplitudes in
    `unit`, such as "deg", if this is a unit of the signal's displacement. Raises Refusal if the record does not
    oscillate, has too few cycles, or is not suited for another reason (see `law_free`).

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
    """Return a clause on how the damping ratio changes with the amplitude, from its values at three falling amplitudes.

    Each pair of the three ratios is compared. A difference counts only if it is larger than three of its standard
    errors, and larger than 10 % of the middle ratio. If both steps, from the first to the middle and from the middle to
    the last ratio, count and have opposite signs, the clause says that the middle ratio is the smallest or the largest.
    Otherwise it says that the ratio grows with the amplitude, grows as the amplitude falls, or does not clearly change.
    """
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


MOST_STATED = 1000.0
"""Largest ratio of the residual to the noise that a remark states as a number (conventional)."""
VISCOUS = "Each oscillation is assumed to be a sinusoid with viscous damping."


@once_per_record
def _other_motion(signal: Signal, no_law_fits: bool, unexplained: float = 0.0) -> OtherMotion | None:
    """Return the motion of a signal that is not a free decay of one oscillator, such as beats or growth.

    The result contains the kind of motion, its modes, and its size, which is not tested here (`no_free_decay` does).
    Return None if the signal may be a free decay, or if it has no period. `no_law_fits`: whether no law of one
    oscillator fits the record. If True, three kinds of second modes are accepted in addition: harmonics of the first
    frequency, modes that soon decay, and modes close to the first frequency without a rising amplitude, if the two beat
    and explain the record to its noise. `unexplained`: as in `find_other_motion`.
    """
    try:
        period = features(signal).period
    except Refusal:
        return None
    return find_other_motion(signal.t, signal.y, period, no_law_fits, unexplained)


def no_free_decay(signal: Signal, no_law_fits: bool = False, unexplained: float = 0.0) -> Verdict | None:
    """Return the verdict on a signal that is not the free decay of one oscillator; None if it may be such a decay.

    The verdict contains the motion and its modes, with amplitudes in `signal.unit`, but no damping law. The signal is
    searched for other motions, such as a second oscillation or growth. It may be a free decay if none is found, or if
    the motion that is found has a `size` below `thresholds.OTHER_MOTION`. The size is, for example, the amplitude of a
    second oscillation relative to the first, or the factor of growth minus 1 (see `OtherMotion`). The limit is
    `thresholds.SMALL_OTHER_MOTION` if two oscillations explain the record to its noise, and no law fits or they are of
    close frequencies and explain much more than the best law.

    Parameters
    ----------
    signal
        The signal.
    no_law_fits
        Whether no law of one oscillator fits the record. If True, more second oscillations count: those that soon
        decay, those at a multiple of the first frequency (which may also be harmonics of a nonlinear oscillator), and,
        if two oscillations explain the record to its noise, smaller ones and close ones without a rising amplitude.
    unexplained
        Rms of the residual, beyond the noise, that the best law of one oscillator leaves, in `signal.unit`; 0 if it is
        not known. Two close oscillations that explain much more count, even if no amplitude rises.
    """
    other = _other_motion(signal, no_law_fits, unexplained)
    if other is None or not other.clear:
        return None
    small = other.complete and (no_law_fits or (unexplained > 0 and other.kind == "beats"))
    if other.size < (thresholds.SMALL_OTHER_MOTION if small else thresholds.OTHER_MOTION):
        return None
    own = other.modes
    ratios, half = own.ratios, NORMAL_95 * own.errors / (2 * np.pi * own.frequencies)
    scale = (2 * np.pi * own.frequencies) ** DERIVATIVES[signal.quantity]
    columns = [own.frequencies, ratios, ratios - half, ratios + half, own.first / scale, own.last / scale]
    modes = tuple(Oscillation(*row, unit=signal.unit) for row in np.column_stack(columns).tolist())
    first = signal.provenance.start
    duration = float(signal.t[-1] - signal.t[0])
    spread = (modes[0].high - modes[0].low) * modes[0].frequency
    f = modes[0].frequency
    remarks = [] if np.isnan(own.rates).any() else [VISCOUS]
    if other.misfit > MOST_MISFIT:
        noise = f"{fmt.digits(other.misfit, n=2)} times" if other.misfit < MOST_STATED else "far above"
        remarks.append(
            f"The two oscillations do not explain the record: the residual is {noise} the noise, and the intervals are "
            "too narrow."
        )
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
        remarks=tuple(remarks),
    )
    return replace(verdict, sentence=sentence(verdict))


def remark_on(signal: Signal, unexplained: float = 0.0) -> str:
    """Return a remark on a second oscillation; empty if there is none.

    It states the frequency and the amplitude relative to that of the first oscillation, which is not compared with a
    limit; or that there may be two oscillations, if this is not clear (`OtherMotion.clear`). Call this function only if
    `no_free_decay` returned None. `unexplained`: as in `no_free_decay`.
    """
    other = _other_motion(signal, False, unexplained)
    if other is None or len(other.modes.frequencies) < 2:
        return ""
    if not other.clear:
        at = " and ".join(fmt.digits(f) for f in sorted(other.modes.frequencies.tolist()))
        return f"Two oscillations, at {at} Hz, would explain the record far better than the laws; it may contain both."
    at = f"{fmt.digits(other.modes.frequencies[1])} Hz"
    return f"A second oscillation, at {at}, has {fmt.percentage(other.size)} % of the amplitude."
