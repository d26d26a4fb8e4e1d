"""Write a verdict in sentences for a mechanical engineer. No other code reads these sentences."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING

from bayesdamp.formatting import by_ten, digits, probability, with_interval
from bayesdamp.physics.damping import PAPER_TERMS, TERMS, words_of
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import (
    Averages,
    DampingRatio,
    FrequencyAt,
    Grade,
    Interval,
    Mode,
    Motion,
    Share,
)
from bayesdamp.verdict.types import Verdict

if TYPE_CHECKING:
    from bayesdamp.inference.deviation.findings import Findings

UNSEEN = 1e-3
"""Deviation from a law below which it is not given a size."""
ALL = 0.995
"""Share that is written as 100 %."""
LEAST_BOUND = 0.1
"""Percent below which an upper limit is not given: none is 0."""
UNEVEN = 1.25
"""Ratio of an interval's sides up to which it is written with ±."""


def named(damping: str) -> str:
    """A sum's name in words."""
    return " + ".join(words_of(term) for term in damping.split("+"))


def _ratio(r: DampingRatio) -> str:
    return f"{with_interval(r.value, r.low, r.high, ' %', 100)} at {r.amplitude:.2g} {r.unit}"


def sentence(v: Verdict) -> str:
    """The answer in a sentence: the damping, how large it is, how well the law holds; of several records, how many."""
    return f"{v.records} records: {_answer(v)}" if v.records > 1 else _answer(v)


def _answer(v: Verdict) -> str:
    if v.motion is not None:
        said = seen_instead(v, v.motion)
        steady = v.motion is Motion.STEADY
        return f"{_first(said)}." if steady else f"Not the free decay of one oscillator: {said}."
    if v.unexplained_pct > 100 * thresholds.UNDESCRIBED:
        return (
            "No damped oscillation that was weighed describes the record: the nearest, with "
            f"{named(v.damping)} damping, leaves {_left(0.01 * v.unexplained_pct)}."
        )
    size, frequency = _size(v), _frequency(v)
    if not v.damping:
        return f"{_first(size)}{frequency}."
    if v.contradicted:
        return (
            f"{_first(size)}{frequency}, measured without a law of damping: the law that fits best, "
            f"{named(v.damping)}, contradicts this, so none is named."
        )
    if v.grade is Grade.DEVIATES:
        measured = ", measured without a law of damping" if v.law_free else ""
        nearest = f"the nearest law of damping is {named(v.damping)}, {_misses(v)}"
        return f"{_first(size)}{frequency}{measured}; {nearest}{_as_one_power(v)}."
    if v.decided:
        budget = _budget(v)
        return (
            f"{_first(named(v.damping))} damping (probability {probability(v.probability)}): "
            f"{size}{frequency}{budget}{_as_one_power(v)}{_hold(v)}."
        )
    each = [(v.damping, v.probability), *((r.damping, r.probability) for r in v.rivals)]
    likely = sorted((one for one in each[1:] if one[1] >= thresholds.NAMED), key=lambda one: -one[1])
    first = each[:1] if v.probability >= thresholds.NAMED or not likely else []
    shown = sorted([*first, *likely[:2]], key=lambda one: -one[1])
    between = [f"{named(name)} ({probability(p)})" for name, p in shown]
    sure = [s.term for s in v.energy if s.probability >= thresholds.TERM_SURE]
    part = (
        f"; {' and '.join(words_of(t) for t in sure)} {'is' if len(sure) == 1 else 'are'} sure"
        if sure
        else ""
    )
    return f"{_first(size)}{frequency}; damping {' or '.join(between)}{part}{_as_one_power(v)}{_hold(v)}."


def _size(v: Verdict) -> str:
    """How large the damping is: Q or the rate of an envelope, else ratios at amplitudes."""
    if v.quality_factor is not None:
        return f"Q = {by_ten(with_interval(v.quality_factor.value, v.quality_factor.low, v.quality_factor.high))}"
    if v.rate is not None:
        return f"decay rate {by_ten(with_interval(v.rate.value, v.rate.low, v.rate.high, ' ' + v.rate.unit))}"
    ratios = [r for r in v.damping_ratio if isfinite(r.value)]
    if not ratios:
        return "the size of the damping is not determined"
    last = f", {_ratio(ratios[-1])}" if len(ratios) > 1 else ""
    return f"equivalent damping ratio {_ratio(ratios[0])}{last}"


def _as_one_power(v: Verdict) -> str:
    """Of an envelope, as which power of the velocity it loses."""
    envelope = v.quantity == "envelope" and v.exponent is not None
    return f"; it {loses_like(v.exponent, v.damping)}" if envelope else ""  # type: ignore[arg-type]


def _misses(v: Verdict) -> str:
    """Say by what a law misses a record: the largest, relative to its threshold, of what `grade_of` looks at."""
    damping, restoring = v.deviation, v.restoring_deviation
    found = [
        (
            v.unexplained_pct / (100 * thresholds.UNEXPLAINED),
            f"which leaves {_left(0.01 * v.unexplained_pct)}",
        )
    ]
    if damping is not None:
        text = f"from which the damping deviates by {_share_of(damping)}"
        found.append((damping.value / thresholds.DEVIATES, text))
    if restoring is not None:
        text = f"while the restoring force deviates from its law by {_share_of(restoring)}"
        found.append((restoring.low / thresholds.RESTORING_DEVIATES, text))
    return max(found)[1]


def _share_of(i: Interval) -> str:
    return f"{100 * i.value:.2g} % ({100 * i.low:.2g} to {100 * i.high:.2g})"


def frequency_off(v: Verdict, by_law: FrequencyAt) -> str:
    """Remark that the restoring law's frequency is not the measured one."""
    value = plus_minus(Interval(by_law.value, by_law.low, by_law.high, "Hz"))
    return (
        f"The best restoring law, {_plain(v.restoring)}, has {value} at {by_law.amplitude:.2g} {by_law.unit}, which "
        "contradicts the measured frequency. The frequency given is the measured one, and it is not extrapolated "
        "to small oscillations."
    )


def _frequency(v: Verdict) -> str:
    """The natural frequency; where it lies beyond the record, that at an amplitude of the record before it."""
    at = v.frequency_at
    if v.quantity == "envelope":
        return ""  # it is given, and Q has it
    if at is None:
        return "" if v.frequency is None else f", natural frequency {plus_minus(v.frequency)}"
    seen = plus_minus(Interval(at.value, at.low, at.high, "Hz"))
    if v.frequency is None:
        return f", frequency {seen} at {at.amplitude:.2g} {at.unit}"
    if not extrapolated(v.frequency, at):
        return f", natural frequency {plus_minus(v.frequency)}"
    beyond = f"extrapolated to small oscillations: {plus_minus(v.frequency)}"
    return f", frequency {seen} at {at.amplitude:.2g} {at.unit} ({beyond})"


def extrapolated(natural: Interval, at: FrequencyAt) -> bool:
    """Whether the frequency of small oscillations is one that the record does not come to."""
    off = max(abs(natural.value - at.value), 0.5 * (natural.high - natural.low))
    return off > thresholds.EXTRAPOLATED * natural.value


def seen_instead(v: Verdict, motion: Motion) -> str:
    """What is seen in place of the free decay of one oscillator, and how large it is."""
    one = v.modes[0]
    if motion is Motion.STEADY:
        # What it may lose at most, should nothing keep it in motion.
        limit = max(one.damping_ratio, 0.0) + 0.5 * (one.high - one.low)
        cycles = f" over {v.window.cycles:.0f} cycles" if v.window else ""
        return (
            f"no decay is seen: it oscillates at {digits(one.frequency, _slack(one))} Hz with an amplitude of "
            f"{one.first:.3g} {one.unit} that stays{cycles}. Something keeps it in motion, or its damping ratio is "
            f"below {100 * limit:.2g} % (95 %), Q above {float(f'{0.5 / limit:.2g}'):,.0f}"
        )
    if motion is Motion.EXCITED:
        f, span = f"{one.frequency:.3g} Hz", f"{one.first:.2g} and {one.last:.2g} {one.unit}"
        return (
            f"at {f} its amplitude rises and falls again and again, between {span}, as random forces would have "
            "it. Measuring its damping takes a record in which nothing excites it, or a method for ambient vibration"
        )
    if motion is Motion.GROWING:
        return f"its oscillation at {_mode(one)} grows, from {one.first:.2g} to {one.last:.2g} {one.unit}"
    other = v.modes[1]
    share = f"{100 * max(other.first, other.last) / max(one.first, one.last):.2g} %"
    if motion is Motion.DRIVEN:
        kept, falls = sorted((one, other), key=lambda m: abs(m.damping_ratio))
        return (
            f"something keeps it in motion at {digits(kept.frequency, _slack(kept))} Hz with an amplitude of "
            f"{kept.last:.2g} {kept.unit}, besides a decay at {_mode(falls)}"
        )
    what = "two oscillations beat" if motion is Motion.BEATS else "two modes are in it"
    second = f"the second with {share} of the amplitude of the first"
    return f"{what}, at {_mode(one)} and at {_mode(other)}, {second}"


def _mode(m: Mode) -> str:
    ratio = with_interval(m.damping_ratio, m.low, m.high, " %", 100).replace(" (", ", ").rstrip(")")
    return f"{digits(m.frequency, _slack(m))} Hz (damping ratio {ratio})"


def _slack(m: Mode) -> float:
    """A frequency in Hz is known about as well as the damping ratio's width in it."""
    return max((m.high - m.low) * m.frequency, 1e-4 * m.frequency)


def _left(share: float) -> str:
    """What is not explained, as a share of the amplitude."""
    return f"{100 * share:.2g} % of the amplitude" if share < 1 else "more than the amplitude itself"


def _first(text: str) -> str:
    return text[:1].upper() + text[1:]


def given(i: Interval) -> bool:
    """Whether a number has no width, for it was given and not found."""
    return i.high - i.low <= 2e-12 * abs(i.value)


def plus_minus(i: Interval) -> str:
    """`3.4643 ± 0.0006 Hz`; an interval with one side much longer stands in brackets; without a width it was given."""
    up, down = i.high - i.value, i.value - i.low
    half, unit = 0.5 * (up + down), f" {i.unit}" if i.unit else ""
    if given(i):
        return f"{i.value:.5g}{unit} (specified)"
    if max(up, down) > UNEVEN * max(min(up, down), 1e-12):
        return with_interval(i.value, i.low, i.high, unit)
    return f"{digits(i.value, half)} ± {digits(half, half)}{unit}"


def _budget(v: Verdict) -> str:
    shares = [s for s in v.energy if s.term in v.damping.split("+")]
    if len(shares) < 2:
        return ""
    parts = [
        f"{words_of(s.term)} {100 * s.share:.0f} % ({100 * s.low:.0f} to {100 * s.high:.0f})" for s in shares
    ]
    return f"; of the energy lost, {', '.join(parts)}"


def energy_of(v: Verdict) -> tuple[str, ...]:
    """Sentences: the energy budget, and what is bounded of other forms; as many as there is something to say in."""
    parts = [_share(v, s) for s in v.energy if s.high >= 0.005]
    listed = {t for r in v.rivals if r.probability >= thresholds.NAMED for t in r.damping.split("+")}
    absent = [
        f"{words_of(b.form)} {max(100 * b.share_below, LEAST_BOUND):.2g} %"
        for b in v.other_forms
        if b.form not in listed
    ]
    own = {s.term for s in v.energy}
    forms = [
        r for r in v.rivals if r.probability >= thresholds.NAMED and not own.issuperset(r.damping.split("+"))
    ]
    other = max(forms, key=lambda r: r.probability, default=None)
    shares = ", ".join(parts)
    if other is not None and parts:
        # Shares are those of sums of the terms, and hold only where the damping is not of that other form.
        form = f"by {named(other.damping)} damping"
        chance = f"with probability {probability(other.probability)}"
        likelier = other.probability > v.probability
        shares = f"{form} {chance}; without it {shares}" if likelier else f"{shares}; or {form}, {chance}"
    said = (
        f"Energy lost: {shares}." if parts else "",
        f"Other damping terms can account for at most (95 %): {', '.join(absent)}." if absent else "",
    )
    return tuple(filter(None, said))


def _share(v: Verdict, s: Share) -> str:
    """A term's share with its interval over all that is possible; of the sole term of the answer, how probable it is
    that nothing else takes energy, in place of an interval that begins at 0 where a rival without it is possible."""
    name = words_of(s.term)
    if s.low >= ALL:
        return f"all of it {name}"
    if s.term == v.damping and s.share >= ALL:
        said = f"all of it {name}" if v.probability >= 0.5 else f"{name} alone"
        return f"{said} with probability {probability(v.probability)}"
    if round(100 * s.share) == 0:
        return f"{name} at most {100 * s.high:.0f} %"
    return f"{name} {100 * s.share:.0f} % ({100 * s.low:.0f} to {100 * s.high:.0f})"


def _hold(v: Verdict) -> str:
    if v.deviation is None:
        return ""
    d = v.deviation
    if v.grade is Grade.EXACT:
        return f"; the law holds within {max(100 * d.high, 0.1):.2g} %"
    if d.value < UNSEEN:
        return f"; no deviation from the law is detected (95 %: below {100 * d.high:.2g} %)"
    within = f"; the law holds within {100 * d.value:.2g} % (95 %: below {100 * d.high:.2g} %)"
    o = v.over_law
    if o is None:
        return within
    times = with_interval(o.value, o.low, o.high)
    return f"{within} but at {o.amplitude:.2g} {o.unit}, where the damping is {times} times the law's"


def loses_like(e: Interval, damping: str = "") -> str:
    """Return `grows as v^(1.02 ± 0.03), which is viscous`; an uneven interval follows in brackets.

    damping: the sum that is named. Where it has a term other than the three laws, an exponent near one of these laws
    does not mean that the record follows it.
    """
    shown = plus_minus(e)
    grows = f"grows as v^({shown})" if "±" in shown else f"grows as v^{shown}"
    held = _held(e)
    if held is None:
        return grows
    power, name = held
    if all(term in PAPER_TERMS for term in damping.split("+") if term):
        return f"{grows}, which is {name}"
    return f"{grows}, near the v^{power} of {name} damping"


def _held(e: Interval) -> tuple[int, str] | None:
    """Which of the three laws an exponent's interval holds alone: its power and its name."""
    if e.high - e.low > 2 * thresholds.EXPONENT_NAMED:
        return None
    held = [
        (p, name)
        for p, name in ((0, "Coulomb"), (1, "viscous"), (2, "quadratic"))
        if e.low - 0.02 <= p <= e.high + 0.02
    ]
    return held[0] if len(held) == 1 else None


def called(name: str) -> str:
    """A parameter of a damping, as a sentence has it: a coefficient by its term."""
    term = next((t for t in TERMS.names() if TERMS.get(t).parameter == name), None)
    return f"the {_plain(name)}" if term is None else f"the coefficient of {words_of(term)} damping"


def _plain(name: str) -> str:
    """A parameter's name in a sentence."""
    return name.replace("_", " ")


def remarks(
    v: Verdict,
    found: Findings,
    same: bool,
    notes: Sequence[str],
    twins: Sequence[tuple[str, str, float]] = (),
) -> tuple[str, ...]:
    """Reservations, the largest first, each with its size.

    twins: a term of the answer, one that takes as much from every amplitude, and how much of the energy that may have.
    """
    said = [(0.0, note) for note in notes]
    if not v.contradicted:
        said += [
            (
                0.9,
                f"The record cannot distinguish {words_of(term)} damping from {words_of(twin)}: both lose the same at "
                f"every amplitude and differ only within a cycle. Up to {100 * share:.0f} % of the loss may be the "
                "other.",
            )
            for term, twin, share in twins
        ]
        said += [
            (0.6, f"The record does not determine the {_plain(name)}; its interval is just the prior.")
            for name in found.untold
        ]
        said += [
            (
                0.6,
                f"Only a combination of {called(one)} and {called(other)} is determined, not each separately.",
            )
            for one, other in found.tied
        ]
    if not same and v.grade is not Grade.DEVIATES:
        other = named(next(iter(found.exact)))
        text = (
            f"If damping and spring followed their laws exactly, {other} would be the most probable damping."
        )
        said.append((1.0, text))
    if found.unexplained >= thresholds.REMARK:
        text = f"{_first(_left(found.unexplained))} is not explained by the law."
        said.append((found.unexplained, text))
    if (drift := abs(found.midline)) >= thresholds.MIDLINE:
        text = f"The midline drifts by {100 * drift:.2g} % of the first amplitude over the record."
        said.append((drift, text))
    fallen = found.amplitudes[1] / found.amplitudes[0]
    if fallen > thresholds.HARDLY_FALLS:
        by = f"falls by only {100 * (1 - fallen):.0f} %" if fallen < 1 else "does not fall"
        said.append((0.5, f"The amplitude {by}, so damping models are hard to distinguish."))
    if v.exponent is not None:
        text = f"Fitted as a power law, the damping force {loses_like(v.exponent, v.damping)}."
        said.append((0.0, text))
    if v.averages is not None:
        said.append(_averaged(v.averages))
    return tuple(text for _, text in sorted(said, key=lambda item: -item[0]))


def _averaged(a: Averages) -> tuple[float, str]:
    """Say what averaging over cycles moves, with the weight of the remark."""
    fine = a.error_sd <= thresholds.AVERAGED
    how = (
        f"; that moves no parameter by more than {a.error_sd:.1g} of its standard deviation from the full motion"
        if fine
        else f", too many for the equation of motion; that moves parameters by up to {a.error_sd:.2g} of their "
        "standard deviations"
        if isfinite(a.error_sd)
        else "; the equation of motion could not be solved to check this approximation"
    )
    return 0.0 if fine else 0.5, f"Amplitude and phase were averaged over {a.cycles:,.0f} cycles{how}."
