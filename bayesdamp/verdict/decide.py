"""The decisions: a pure function of a weighing's numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite, log

from bayesdamp.inference.deviation.findings import Findings
from bayesdamp.inference.deviation.numbers.draws import Quantity
from bayesdamp.physics.damping import TERMS, twins_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.units import parameter_unit
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import (
    Averages,
    Bound,
    Coefficient,
    DampingRatio,
    FrequencyAt,
    Grade,
    Interval,
    LawFreeAt,
    OverLaw,
    Rival,
    Share,
    Window,
)
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import frequency_off, remarks, sentence


def decide(
    found: Findings,
    *,
    record: str,
    unit: str = "rad",
    quantity: str = "angle",
    measured: bool = True,
    approximate: bool = True,
    window: Window | None = None,
    notes: Sequence[str] = (),
    averages: Averages | None = None,
    law_free: LawFreeAt | None = None,
) -> Verdict:
    """The verdict on one record.

    unit: of the displacement; quantity: see `Verdict`; measured: whether probabilities are capped; approximate: whether
    laws may hold approximately. A damping is decided where its probability is large and the exact laws' evidence puts
    it first too. law_free: what is measured without a law, at the amplitudes of the findings' ratios. Where the damping
    ratio contradicts it, it is the answer and no law is; where the frequency alone does, it is the frequency.
    """
    cap = thresholds.CAP if measured and approximate else 1.0
    damping = {name: min(p, cap) for name, p in found.damping.items()}
    first = next(iter(damping))
    same = first == next(iter(found.exact))
    ratios = tuple(
        DampingRatio(r.amplitude, unit, r.value, r.sd_noise, r.sd_law, r.low, r.high) for r in found.ratios
    )
    q = found.frequency_at
    at = None if q is None else FrequencyAt(ratios[-1].amplitude, unit, q.value, q.low, q.high)
    contradicted = law_free is not None and _contradict(ratios, law_free.ratios, thresholds.CONTRADICTS)
    off = (
        law_free is not None
        and at is not None
        and _contradict((at,), (law_free.frequency,), thresholds.CONTRADICTS_FREQUENCY)
    )
    grade = grade_of(found) if approximate else Grade.EXACT
    grade = Grade.DEVIATES if contradicted else grade
    instead = law_free if grade is Grade.DEVIATES else None  # of a law
    natural = None if instead is not None or off else interval_of(found.frequency, "Hz")
    if natural is not None and natural.high - natural.low > thresholds.UNDETERMINED * natural.value:
        natural = None
    untold = untold_twins(found, first)
    decided = (
        grade is not Grade.DEVIATES and found.damping[first] >= thresholds.DECIDED and same and not untold
    )
    shares = [Share(t, q.value, q.low, q.high, found.term[t]) for t, q in found.energy.items()]
    verdict = Verdict(
        record=record,
        grade=grade,
        decided=decided,
        damping=first,
        probability=damping[first],
        rivals=rivals_of(damping, found.exotic),
        restoring=next(iter(found.restoring)),
        restoring_probability=min(next(iter(found.restoring.values())), cap),
        frequency=natural,
        exponent=None if found.exponent is None else interval_of(found.exponent),
        damping_ratio=ratios if instead is None else instead.ratios,
        energy=tuple(sorted(shares, key=lambda s: -s.share)),
        other_forms=(
            *(Bound(t, found.bound[t]) for t in found.bound if t not in first.split("+")),
            *([Bound("any other form", found.other)] if approximate else []),
        ),
        deviation=interval_of(found.deviation) if approximate else None,
        unnamed=None if found.unnamed is None else interval_of(found.unnamed),
        unexplained_pct=100 * found.unexplained,
        noise_pct=100 * found.noise,
        midline_drift_pct=100 * found.midline,
        frequency_at=_narrowest(at, law_free, off or instead is not None),
        restoring_deviation=interval_of(found.restoring_deviation) if approximate else None,
        law_free=instead is not None,
        contradicted=contradicted,
        coefficients=_coefficients(found, unit),
        window=window,
        averages=averages,
        quantity=quantity,
        over_law=_over_law(found, unit),
    )
    if contradicted:  # what its law says of energy, power and coefficients would contradict the answer
        verdict = replace(verdict, energy=(), other_forms=(), exponent=None, unnamed=None, coefficients=())
    if off and at is not None and instead is None:
        notes = [*notes, frequency_off(verdict, at)]
    said = remarks(verdict, found, same, notes, untold)
    return replace(verdict, remarks=said, sentence=sentence(verdict))


def untold_twins(found: Findings, damping: str) -> tuple[tuple[str, str, float], ...]:
    """A sum's terms, each with a twin that was weighed and that the record does not exclude beside it, and the upper
    limit of that twin's share of the energy."""
    own = damping.split("+")
    pairs = [
        (term, twin) for term in own for twin in twins_of(term) if twin in found.term and twin not in own
    ]
    return tuple(
        (term, twin, found.bound[twin])
        for term, twin in pairs
        if found.bound.get(twin, 0.0) >= thresholds.TWIN
    )


def rivals_of(sums: Mapping[str, float], others: Mapping[str, float]) -> tuple[Rival, ...]:
    """Every sum but the first, and every other form of damping, the likeliest first."""
    found = [Rival(n, p) for n, p in [*list(sums.items())[1:], *others.items()]]
    return tuple(sorted(found, key=lambda r: -r.probability))


def grade_of(found: Findings) -> Grade:
    """How well the laws hold."""
    if (
        found.deviation.value > thresholds.DEVIATES
        or found.restoring_deviation.low > thresholds.RESTORING_DEVIATES
        or found.unexplained > thresholds.UNEXPLAINED
    ):
        return Grade.DEVIATES
    return Grade.EXACT if found.deviation.high <= thresholds.EXACT else Grade.APPROXIMATE


def _contradict(
    by_law: Sequence[DampingRatio | FrequencyAt], measured: Sequence[DampingRatio | FrequencyAt], least: float
) -> bool:
    """Whether one of the values differs by more than `least` of itself and its interval does not meet the measured one
    at `WIDER` times its width; only at amplitudes that both have."""
    wider = thresholds.WIDER
    return any(
        isfinite(one.value)
        and abs(log(one.amplitude / two.amplitude)) < thresholds.SAME_AMPLITUDE
        and abs(one.value - two.value) > least * abs(two.value)
        and (
            one.low > two.value + wider * (two.high - two.value)
            or one.high < two.value - wider * (two.value - two.low)
        )
        for one, two in zip(by_law, measured, strict=True)
    )


def _narrowest(at: FrequencyAt | None, law_free: LawFreeAt | None, measured: bool) -> FrequencyAt | None:
    """The frequency at the last amplitude: the measured one where that is the answer, or is known better."""
    if law_free is None:
        return at
    other = law_free.frequency
    if at is None or measured:
        return other
    same = abs(log(at.amplitude / other.amplitude)) < thresholds.SAME_AMPLITUDE
    return other if same and other.high - other.low < at.high - at.low else at


def interval_of(q: Quantity, unit: str = "") -> Interval:
    """Return a number's value and interval as a verdict has them."""
    return Interval(q.value, q.low, q.high, unit)


def _over_law(found: Findings, unit: str) -> OverLaw | None:
    """Of the amplitudes at which the damping is surely further from the law than it may be, the one furthest off."""
    off = [
        (max(q.low, 1 / q.high), r.amplitude, q)
        for r, q in zip(found.ratios, found.over_laws, strict=False)
        if max(q.low, 1 / q.high) > 1 + thresholds.DEVIATES
    ]
    if not off:
        return None
    _, amplitude, q = max(off, key=lambda one: one[0])
    return OverLaw(amplitude, unit, q.value, q.low, q.high)


def _coefficients(found: Findings, unit: str) -> tuple[Coefficient, ...]:
    terms = [TERMS.get(t) for t in found.best.damping]
    law = found.best.restoring
    own = {
        *LAWS.get(law).parameters,
        *(n for t in terms for n in (t.parameter, *(p.name for p in t.inferred))),
    }
    return tuple(
        Coefficient(n, q.value, q.sd_noise, q.sd_law, q.low, q.high, parameter_unit(n, law, unit))
        for n, q in found.coefficients.items()
        if n in own
    )
