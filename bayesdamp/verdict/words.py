"""Write the sentences of a verdict, for a mechanical engineer. No code may read values from these sentences."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, isfinite, pi
from typing import TYPE_CHECKING

from bayesdamp.formatting import digits, percentage, probability, with_error, with_interval
from bayesdamp.physics.damping import TERMS, twins_of, words_of
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import FrequencyAt, Grade, Interval, MotionKind, Oscillation
from bayesdamp.verdict.types import Verdict

if TYPE_CHECKING:
    from bayesdamp.inference.deviation.findings import Findings

UNDETECTED_DEVIATION = 1e-3
"""If the median deviation from a law (a fraction) is smaller than this, the sentence gives only its upper limit."""
WHOLE_ENERGY = 0.995
"""The sentence on the energy says that a term dissipates "all of it" if its fraction of the energy is at least this."""
LEAST_BOUND = 0.1
"""Smallest upper limit of an energy fraction, in per cent, that the sentence states. A smaller limit is replaced by
this, so that it is not rounded to 0."""
ASYMMETRY = 1.25
"""An interval is written with ± if its longer side is at most this many times the shorter one."""


def named(damping: str) -> str:
    """Return the name of a damping sum in words, such as "viscous + Coulomb (dry friction)"."""
    return " + ".join(words_of(term) for term in damping.split("+"))


def sentence(v: Verdict) -> str:
    """Return the verdict as one sentence, which begins with the number of records if there are several."""
    return f"{v.records} records: {_answer(v)}" if v.records > 1 else _answer(v)


def _answer(v: Verdict) -> str:
    """Return the sentence on the damping, its size, the frequency, and how well the damping law holds.

    If the record is not a free decay, the sentence describes its motion instead. If no damping model describes the
    record (`thresholds.UNDESCRIBED`), it says so.
    """
    if v.motion is not None:
        text = describe_motion(v, v.motion)
        steady = v.motion is MotionKind.STEADY
        return f"{_capitalise(text)}." if steady else f"Not the free decay of one oscillator: {text}."
    if v.unexplained_pct > 100 * thresholds.UNDESCRIBED:
        return (
            f"No damping model describes the record: the nearest, {named(v.damping)} damping, leaves "
            f"{_amplitude_share(0.01 * v.unexplained_pct)} unexplained."
        )
    answer = _capitalise(_size(v)) + _frequency(v)
    power = ""
    if v.quantity == "envelope" and v.exponent is not None:
        power = f"; the damping force {power_in_words(v.exponent, v.damping)}"
    if not v.damping:
        return f"{answer}."
    if v.contradicted:
        return (
            f"{answer}, measured without a law of damping: the law that fits best, {named(v.damping)}, contradicts "
            "this, so none is named."
        )
    if v.grade is Grade.DEVIATES:
        # State the worst misfit of the law, relative to its threshold in `grade_of`.
        left = f"which leaves {_amplitude_share(0.01 * v.unexplained_pct)} unexplained"
        misfits = [(v.unexplained_pct / (100 * thresholds.UNEXPLAINED), left)]
        if (i := v.deviation) is not None:
            text = f"from which the damping deviates by {_percentages(i)}"
            misfits.append((i.value / thresholds.DEVIATES, text))
        if (i := v.restoring_deviation) is not None:
            text = f"while the frequency deviates from that of the law by {_percentages(i)}"
            misfits.append((i.low / thresholds.RESTORING_DEVIATES, text))
        _, misfit = max(misfits)
        measured = ", measured without a law of damping" if v.law_free else ""
        return f"{answer}{measured}; the nearest law of damping is {named(v.damping)}, {misfit}{power}."
    if v.decided:
        terms = [s for s in v.energy if s.term in v.damping.split("+")]
        shares = ", ".join(
            f"{words_of(s.term)} {100 * s.share:.0f} % ({100 * s.low:.0f} to {100 * s.high:.0f})"
            for s in terms
        )
        budget = f"; of the energy lost, {shares}" if len(terms) > 1 else ""
        damping = f"{_capitalise(named(v.damping))} damping (probability {probability(v.probability)})"
        return f"{damping}: {_size(v)}{_frequency(v)}{budget}{power}{_law_quality(v)}."
    likely = sorted((r for r in v.rivals if r.probability >= thresholds.NAMED), key=lambda r: -r.probability)
    shown = [(r.damping, r.probability) for r in likely[:2]]
    if v.probability >= thresholds.NAMED or not likely:
        shown = [(v.damping, v.probability), *shown]
    shown.sort(key=lambda item: -item[1])
    dampings = " or ".join(f"{named(name)} ({probability(p)})" for name, p in shown)
    sure = [words_of(s.term) for s in v.energy if s.probability >= thresholds.TERM_SURE]
    certain = f"; among the compared models it surely contains {' and '.join(sure)} damping" if sure else ""
    doubtful = spring_is_doubtful(v.restoring, v.restoring_deviation)
    holds = "" if doubtful else f"{certain}{power}{_law_quality(v)}"
    return f"{answer}; damping {dampings}{holds}."


def spring_is_doubtful(restoring: str, deviation: Interval | None) -> bool:
    """Return whether the frequency surely deviates from a nonlinear restoring law; then nothing surely holds.

    restoring: name of the law; "" for an envelope. deviation: relative deviation from it, or None.
    """
    return (
        restoring not in ("", "linear")
        and deviation is not None
        and deviation.low > thresholds.SPRING_DEVIATES
    )


def _percentages(i: Interval) -> str:
    """Return an interval of a fraction as percentages, such as `26 % (18 to 34)`."""
    return f"{percentage(i.value)} % ({percentage(i.low)} to {percentage(i.high)})"


def at_middle(v: Verdict) -> str:
    """Return the amplitude at which Q or the decay rate of several envelopes is given, such as " at 0.3 V".

    The text is empty for a single envelope, and if the number does not belong to an amplitude.
    """
    if v.records == 1 or not v.decay_rate:
        return ""
    middle = v.decay_rate[len(v.decay_rate) // 2]
    return f" at {digits(middle.amplitude, n=3)} {middle.unit}"


def _size(v: Verdict) -> str:
    """Return the size of the damping in words, with 95 % intervals.

    For an envelope, the text contains Q, or the decay rate if Q is not known. For another record, it contains the
    damping ratios at the first and the last amplitude at which they are finite, or only the first if both amplitudes
    are equal to two digits. If they are finite at no amplitude, it says that the size is not determined.
    """
    if v.quality_factor is not None:
        size = with_interval(v.quality_factor.value, v.quality_factor.low, v.quality_factor.high)
        return f"Q = {size}{at_middle(v)}"
    if v.rate is not None:
        size = with_interval(v.rate.value, v.rate.low, v.rate.high, f" {v.rate.unit}")
        return f"decay rate {size}{at_middle(v)}"
    ratios = [r for r in v.damping_ratio if isfinite(r.value)]
    if not ratios:
        return "the size of the damping is not determined"
    ends = {f"{digits(r.amplitude, n=2)} {r.unit}": r for r in (ratios[-1], ratios[0])}
    texts = [f"{with_interval(r.value, r.low, r.high, ' %', 100)} at {at}" for at, r in ends.items()]
    return f"equivalent damping ratio {', '.join(reversed(texts))}"


def frequency_remark(v: Verdict, by_law: Interval) -> str:
    """Return the remark that the frequency from the best restoring law contradicts the measured frequency.

    `by_law`: the frequency in Hz from the restoring law, at the amplitude of the measured frequency.
    """
    return (
        f"The best restoring law, {_in_words(v.restoring)}, contradicts the measured frequency: at the same amplitude "
        f"it gives {plus_minus(by_law)}. The frequency given is the measured one, and it is not extrapolated to small "
        "oscillations."
    )


def spring_remark(v: Verdict, deviation: Interval) -> str:
    """Return the remark that the frequency deviates from that of the best restoring law by the fraction `deviation`."""
    return (
        f"The frequency deviates from the restoring law, {_in_words(v.restoring)}, by {_percentages(deviation)}. Check "
        "unit and scale, and compare all restoring laws; a second oscillation may also look like a nonlinear spring."
    )


def _frequency(v: Verdict) -> str:
    """Return a clause with the natural frequency, beginning with a comma; "" for an envelope or if none is known.

    If the natural frequency is not known, or only an extrapolation, the clause begins with the frequency at an
    amplitude of the record.
    """
    at = v.frequency_at
    if v.quantity == "envelope":
        return ""  # it was specified, and Q contains it
    natural = None if v.frequency is None else plus_minus(v.frequency)
    if at is None or (v.frequency is not None and not is_extrapolated(v.frequency, at)):
        return "" if natural is None else f", natural frequency {natural}"
    measured = plus_minus(Interval(at.value, at.low, at.high, "Hz"))
    beyond = "" if natural is None else f" (extrapolated to small oscillations: {natural})"
    return f", frequency {measured} at {digits(at.amplitude, n=2)} {at.unit}{beyond}"


def is_extrapolated(natural: Interval, at: FrequencyAt) -> bool:
    """Return whether the natural frequency is only an extrapolation to small oscillations.

    This is the case if half its 95 % interval, or its difference from the frequency `at` (at an amplitude of the
    record), is more than the fraction `thresholds.EXTRAPOLATED` of the natural frequency.
    """
    off = max(abs(natural.value - at.value), 0.5 * (natural.high - natural.low))
    return off > thresholds.EXTRAPOLATED * natural.value


def describe_motion(v: Verdict, motion: MotionKind) -> str:
    """Return a text on the kind of motion in a record that is not a free decay of one oscillator.

    The text contains the frequencies, amplitudes and damping ratios in `v.modes` with their units, without a full stop.
    """
    first = v.modes[0]
    begin, end = digits(first.first, n=2), f"{digits(first.last, n=2)} {first.unit}"
    if motion is MotionKind.STEADY:
        # Upper limit of the damping ratio, if nothing drives the oscillation.
        limit = max(first.damping_ratio, 0.0) + 0.5 * (first.high - first.low)
        quality = f", Q above {float(f'{0.5 / limit:.2g}'):,.0f}" if limit > 0 else ""
        cycles = f" over {v.window.cycles:.0f} cycles" if v.window else ""
        return (
            f"no decay is detected: it oscillates at {_frequency_of(first)} Hz with a constant amplitude of "
            f"{digits(first.first, n=3)} {first.unit}{cycles}. Either something drives it, or its damping ratio is "
            f"below {percentage(limit)} % (95 %){quality}"
        )
    if motion is MotionKind.EXCITED:
        return (
            f"at {digits(first.frequency, n=3)} Hz its amplitude rises and falls repeatedly "
            f"between {begin} and {end}, as under random forces. To measure the damping, record a decay in which "
            "nothing excites it, or use a method for ambient vibration"
        )
    if motion is MotionKind.GROWING:
        return f"its oscillation at {_mode(first)} grows from {begin} to {end}"
    second = v.modes[1]
    if motion is MotionKind.DRIVEN:
        driven, decaying = sorted((first, second), key=lambda m: abs(m.damping_ratio))
        return (
            f"something drives it at {_frequency_of(driven)} Hz with an amplitude of "
            f"{digits(driven.last, n=2)} {driven.unit}, in addition to a decay at {_mode(decaying)}"
        )
    what = "two oscillations beat" if motion is MotionKind.BEATS else "it contains two modes"
    share = f"{percentage(max(second.first, second.last) / max(first.first, first.last))} %"
    return f"{what}, at {_mode(first)} and at {_mode(second)}, the second with {share} of the amplitude of the first"


def _mode(m: Oscillation) -> str:
    """Return frequency and damping ratio of an oscillation as text, with units and the ratio's 95 % interval."""
    ratio = with_interval(m.damping_ratio, m.low, m.high, " %", 100).replace(" (", ", ").rstrip(")")
    return f"{_frequency_of(m)} Hz (damping ratio {ratio})"


def _frequency_of(m: Oscillation) -> str:
    """Return the frequency of a sinusoid in Hz as text without unit, rounded to its uncertainty.

    The uncertainty is the frequency times the width of the damping ratio's 95 % interval, at least 1e-4 of the
    frequency.
    """
    return digits(m.frequency, max((m.high - m.low) * m.frequency, 1e-4 * m.frequency))


def _amplitude_share(share: float) -> str:
    """Return a fraction of the first amplitude as text, such as `2 % of the amplitude`."""
    return f"{percentage(share)} % of the amplitude" if share < 1 else "more than the amplitude itself"


def _capitalise(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[:1].upper() + text[1:]


def is_specified(i: Interval) -> bool:
    """Return whether a number counts as specified and not inferred, which is so if its interval has no width."""
    return i.high - i.low <= 2e-12 * abs(i.value)


def plus_minus(i: Interval) -> str:
    """Return a number with its 95 % interval as text, such as `3.4643 ± 0.0006 Hz`, where ± is half the interval.

    An asymmetric interval is in brackets. A value whose interval has no width is followed by "(specified)".
    """
    up, down = i.high - i.value, i.value - i.low
    half, unit = 0.5 * (up + down), f" {i.unit}" if i.unit else ""
    if is_specified(i):
        return f"{digits(i.value, n=5)}{unit} (specified)"
    if max(up, down) > ASYMMETRY * max(min(up, down), 1e-12):
        return with_interval(i.value, i.low, i.high, unit)
    return f"{with_error(i.value, half)}{unit}"


def energy_sentences(v: Verdict) -> tuple[str, ...]:
    """Return up to two sentences: on the energy that each term dissipates, and on limits for other damping terms.

    The limits are 95 % upper limits of the fraction of the energy. There are no sentences if the verdict contains no
    energies, for example because no damping law is the answer.
    """
    texts, stated = [], [s for s in v.energy if s.high >= 0.005]
    limits = {b.form: b.share_below for b in v.other_forms}
    # Terms that lose the same as a stated term at every amplitude, and may cause its loss instead.
    twins = {s.term: [t for t in twins_of(s.term) if limits.get(t, 0.0) >= thresholds.TWIN] for s in stated}
    for s in stated:
        name = " or ".join(words_of(t) for t in (s.term, *twins[s.term]))
        if s.low >= WHOLE_ENERGY:
            texts.append(f"all of it {name}")
        elif s.term == v.damping and s.share >= WHOLE_ENERGY:
            # State the probability and no interval, which starts at 0 where another damping is possible.
            whole = f"all of it {name}" if v.probability >= 0.5 else f"{name} alone"
            texts.append(f"{whole} with probability {probability(v.probability)}")
        elif round(100 * s.share) == 0:
            texts.append(f"{name} at most {100 * s.high:.0f} %")
        else:
            texts.append(f"{name} {100 * s.share:.0f} % ({100 * s.low:.0f} to {100 * s.high:.0f})")
    shares = ", ".join(texts)
    likely = [r for r in v.rivals if r.probability >= thresholds.NAMED]
    listed = {t for r in likely for t in r.damping.split("+")}.union(twins, *twins.values())
    absent = ", ".join(
        f"{words_of(b.form)} {percentage(max(b.share_below, 0.01 * LEAST_BOUND))} %"
        for b in v.other_forms
        if b.form not in listed
    )
    own = {s.term for s in v.energy}
    forms = [r for r in likely if not own.issuperset(r.damping.split("+"))]
    other = max(forms, key=lambda r: r.probability, default=None)
    if other is not None and shares:
        # The energy fractions are those of the compared sums; they are wrong if the damping has the other form.
        form = f"by {named(other.damping)} damping"
        chance = f"with probability {probability(other.probability)}"
        if other.probability > v.probability:
            shares = f"{form} {chance}; without it {shares}"
        else:
            shares = f"{shares}; or {form}, {chance}"
    sentences = []
    if shares:
        sentences.append(f"Energy lost: {shares}.")
    if absent:
        limits = "Of the energy lost, each of these other damping terms can account for at most (95 %)"
        sentences.append(f"{limits}: {absent}.")
    return tuple(sentences)


def noise_sentence(v: Verdict) -> list[str]:
    """Return a list with a sentence that states the standard deviation of the noise of each sample of the record.

    It is given in % of the first amplitude. The list is empty if the verdict contains no noise.
    """
    return [f"Noise: {digits(v.noise_pct, n=2)} % of the first amplitude."] if isfinite(v.noise_pct) else []


def deviation_limit(deviation: Interval) -> str:
    """Return the upper end of a relative deviation from the law in per cent, at least 0.1, without the sign %."""
    return percentage(max(deviation.high, 0.001))


def _law_quality(v: Verdict) -> str:
    """Return the clause on how well the damping law holds, beginning with a semicolon.

    The text is empty if no deviation from the law was inferred.
    """
    if v.deviation is None:
        return ""
    d, limit = v.deviation, deviation_limit(v.deviation)
    if v.grade is Grade.EXACT:
        return f"; the law holds within {limit} %"
    if d.value < UNDETECTED_DEVIATION:
        return f"; no deviation from the law is detected (95 %: below {limit} %)"
    within = f"; the law holds within {percentage(d.value)} % (95 %: below {limit} %)"
    o = v.over_law
    if o is None:
        return within
    times = with_interval(o.value, o.low, o.high)
    return (
        f"{within} but at {digits(o.amplitude, n=2)} {o.unit}, where the damping is {times} times the law's"
    )


def power_in_words(e: Interval, damping: str = "") -> str:
    """Return a text on the exponent of a power law of the damping force.

    An example is `grows as v^(1.02 ± 0.03), which is viscous`. e: exponent of the velocity v with its 95 % interval.
    damping: damping sum that the verdict names, such as "viscous+coulomb"; "" for none.

    The text names Coulomb, viscous or quadratic damping (exponents 0, 1, 2) under two conditions: half the interval is
    at most `thresholds.EXPONENT_NAMED`, and the interval, widened by `thresholds.EXPONENT_MARGIN` at both ends,
    contains just one of these exponents. If `damping` is another sum, the text only says that the exponent is near that
    of the damping with this exponent, because friction and drag together may grow like viscous damping.
    """
    shown = plus_minus(e)
    grows = f"grows as v^({shown})" if "±" in shown else f"grows as v^{shown}"
    if e.high - e.low > 2 * thresholds.EXPONENT_NAMED:
        return grows
    low, high = e.low - thresholds.EXPONENT_MARGIN, e.high + thresholds.EXPONENT_MARGIN
    laws = [(p, name) for p, name in ((0, "Coulomb"), (1, "viscous"), (2, "quadratic")) if low <= p <= high]
    if len(laws) != 1:
        return grows
    power, name = laws[0]
    if damping in ("", name.lower()):
        return f"{grows}, which is {name}"
    return f"{grows}, near the v^{power} of {name} damping"


def twin_remark(term: str, twin: str, share: float, records: int = 1) -> str:
    """Return the remark that records cannot distinguish a damping term from its twin.

    A twin is another term with the same energy loss at every amplitude. share: the fraction of the energy, from 0 to 1,
    that the twin may dissipate at most. records: number of records of the verdict.
    """
    what = "The record" if records == 1 else "No record"
    can = "cannot distinguish" if records == 1 else "can distinguish"
    return (
        f"{what} {can} {words_of(term)} damping from {words_of(twin)}: both lose the same at every amplitude and "
        f"differ only within a cycle. Up to {100 * share:.0f} % of the loss may be the other."
    )


def parameter_in_words(name: str) -> str:
    """Return the name of a parameter in words, such as `the coefficient of viscous damping` for zeta."""
    term = next((t for t in TERMS.names() if TERMS.get(t).parameter == name), None)
    return f"the {_in_words(name)}" if term is None else f"the coefficient of {words_of(term)} damping"


def _in_words(name: str) -> str:
    """Return a name with spaces in place of underscores."""
    return name.replace("_", " ")


def remarks(
    v: Verdict,
    findings: Findings,
    same: bool,
    notes: Sequence[str],
    twins: Sequence[tuple[str, str, float]] = (),
) -> tuple[str, ...]:
    """Return the remarks on a verdict, the most important first.

    Parameters
    ----------
    v
        The verdict.
    findings
        The numbers from which it was decided.
    same
        Whether the same damping is the most probable one if the laws are assumed to hold exactly. If False, a remark
        says so, unless the grade is `DEVIATES`.
    notes
        Sentences on the record, which are added to the remarks.
    twins
        Terms of the damping whose twin (a term with the same energy loss at every amplitude) cannot be excluded, as
        `decide.possible_twins` returns them.
    """
    weighted = [(0.0, note) for note in notes]
    if not v.contradicted:
        for term, twin, share in twins:
            weighted.append((0.9, twin_remark(term, twin, share)))
        for name in findings.undetermined:
            text = f"The record does not determine the {_in_words(name)}; its interval is just the prior."
            weighted.append((0.6, text))
        for first, second in findings.inseparable:
            pair = f"{parameter_in_words(first)} and {parameter_in_words(second)}"
            weighted.append((0.6, f"Only a combination of {pair} is determined, not each separately."))
    if not same and v.grade is not Grade.DEVIATES:
        other = named(next(iter(findings.damping_if_exact)))
        text = (
            f"If damping and spring followed their laws exactly, {other} would be the most probable damping."
        )
        weighted.append((1.0, text))
    if findings.unexplained >= thresholds.REMARK:
        size = _amplitude_share(findings.unexplained)
        text = f"A residual of {size} is explained neither by the law nor by the noise."
        weighted.append((findings.unexplained, text))
    if (drift := abs(findings.midline)) >= thresholds.MIDLINE:
        text = f"The midline drifts by {percentage(drift)} % of the first amplitude over the record."
        weighted.append((drift, text))
    fall = 1 - findings.amplitudes[1] / findings.amplitudes[0]
    ratio = findings.ratios[len(findings.ratios) // 2] if findings.ratios else None
    # A law that holds gives the fall more accurately than two amplitudes, which noise changes.
    if ratio is not None and ratio.low > 0 and not v.law_free:
        fall = 1 - exp(-2 * pi * ratio.value * findings.cycles)
    if fall < 1 - thresholds.HARDLY_FALLS:
        by = f"falls by only {percentage(fall)} %" if fall > 0 else "does not fall"
        weighted.append((0.5, f"The amplitude {by}, so damping models are hard to distinguish."))
    if v.exponent is not None:
        text = f"Fitted as a power law, the damping force {power_in_words(v.exponent, v.damping)}."
        weighted.append((0.0, text))
    if v.averages is not None:
        error = v.averages.error_sd
        small = error <= thresholds.AVERAGED
        if small:
            limit = digits(error, n=1)
            effect = f"; this approximation moves no parameter by more than {limit} of its standard deviation"
        elif isfinite(error):
            effect = (
                ", because the equation of motion over so many would need too much memory; this approximation moves "
                f"parameters by up to {digits(error, n=2)} of their standard deviations"
            )
        else:
            effect = "; the equation of motion could not be solved to check this approximation"
        text = f"Amplitude and phase of {v.averages.cycles:,.0f} cycles were averaged over blocks of cycles{effect}."
        weighted.append((0.0 if small else 0.5, text))
    return tuple(text for _, text in sorted(weighted, key=lambda item: -item[0]))
