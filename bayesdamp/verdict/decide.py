"""Decide on a verdict, the answer on a record, from the numbers (findings) of a model comparison."""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from bayesdamp.inference.deviation.draws import Quantity
from bayesdamp.inference.deviation.findings import Findings
from bayesdamp.physics.damping import TERMS, twins_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.types import NORMAL_95, LawFreeDamping
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import (
    Averages,
    Bound,
    Coefficient,
    DampingRatio,
    FrequencyAt,
    Grade,
    Interval,
    OverLaw,
    Rival,
    Share,
    UsedWindow,
)
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import frequency_remark, remarks, sentence, spring_is_doubtful, spring_remark


def decide(
    findings: Findings,
    *,
    record: str,
    unit: str = "rad",
    quantity: str = "angle",
    measured: bool = True,
    approximate: bool = True,
    window: UsedWindow | None = None,
    notes: Sequence[str] = (),
    averages: Averages | None = None,
    law_free: LawFreeDamping | None = None,
) -> Verdict:
    """Decide on the verdict on one record.

    A law-free value is measured without assuming a damping law or a restoring law. It contradicts the value of a law if
    they differ by more than a threshold, and their 95 % intervals do not overlap although the law-free one is widened.
    A damping ratio also contradicts a law that has no oscillation of its amplitude.

    A damping is named without reservation (`decided`) if all of these conditions are met: its probability is at least
    `thresholds.DECIDED`; it is also the most probable damping under exact laws; the grade is not `DEVIATES`; and no
    twin of its terms (a term with the same energy loss at every amplitude) is possible.

    The grade is that of `grade_of`, or `DEVIATES` if a law-free damping ratio contradicts the ratio of the best law.
    With the grade `DEVIATES`, no law is named, and the verdict contains the law-free ratios and frequency, if they
    exist, instead of those of the law. With another grade, it contains the law-free frequency in three cases: if it
    contradicts that of the best restoring law, if it has the narrower interval at the same amplitude, or if the law
    gives none. The natural frequency is left out if law-free values replace or contradict it, or if it is not
    determined (`thresholds.UNDETERMINED`). With law-free ratios, the energies of terms and forms are left out too. If a
    law-free ratio contradicts the law, so are exponent and coefficients.

    Parameters
    ----------
    findings
        The numbers of the comparison.
    record
        Name of the record.
    unit
        Base unit of the displacement ("rad", "m" or the sensor's), in which the amplitudes of the findings are.
    quantity
        The recorded quantity, as in `Verdict`.
    measured
        Whether the record is a measurement. If it is, and `approximate` is True, the probabilities of damping and of
        the restoring law are at most `thresholds.CAP`.
    approximate
        Whether the damping and restoring laws may hold approximately. If False, the grade is `EXACT`, unless the
        law-free damping contradicts the law.
    window
        The part of the record that was used.
    notes
        Sentences on the record, for the remarks.
    averages
        The averaging over cycles, if it was used because the record has very many cycles; else None.
    law_free
        Damping ratios and frequency that are measured without a law, at or near the amplitudes of the findings' ratios,
        in the same order; None if they cannot be measured.

    Returns
    -------
    Verdict
        The verdict, with amplitudes in `unit`. `units.in_unit` converts it to the unit of the record's file.
    """
    cap = thresholds.CAP if measured and approximate else 1.0
    damping = {name: min(p, cap) for name, p in findings.damping.items()}
    first = next(iter(damping))
    same = first == next(iter(findings.damping_if_exact))
    ratios = tuple(
        DampingRatio(r.amplitude, unit, r.value, r.sd_noise, r.sd_law, r.low, r.high) for r in findings.ratios
    )
    q = findings.frequency_at
    smallest = min((r.amplitude for r in ratios), default=None)
    by_law = FrequencyAt(smallest, unit, q.value, q.low, q.high) if q and smallest is not None else None
    contradicted = off = narrower = False
    restoring = next(iter(findings.restoring))
    spring_doubtful = spring_is_doubtful(restoring, interval_of(findings.restoring_deviation))
    least = thresholds.CONTRADICTS_THEN if spring_doubtful else thresholds.CONTRADICTS
    own_ratios, own_frequency = (), None
    if law_free is not None:
        own_ratios, own_frequency = _with_intervals(law_free, unit)
        points = sorted((*findings.curve, *findings.ratios), key=lambda r: r.amplitude)
        known = [r.amplitude for r in points]
        rows = np.array([(r.value, r.low, r.high) for r in points]).T
        for own in own_ratios:
            value, low, high = (float(np.interp(own.amplitude, known, row)) for row in rows)
            law_there = Interval(value, low, high)
            contradicted = contradicted or np.isnan(value) or _contradicts(law_there, own, least)
        own = own_frequency
        if by_law is not None and abs(np.log(by_law.amplitude / own.amplitude)) < thresholds.SAME_AMPLITUDE:
            off = _contradicts(by_law, own, thresholds.CONTRADICTS_FREQUENCY)
            narrower = own.high - own.low < by_law.high - by_law.low
    grade = Grade.DEVIATES if contradicted else grade_of(findings) if approximate else Grade.EXACT
    instead = law_free is not None and grade is Grade.DEVIATES  # law-free values replace those of the law
    natural = None if instead or off else interval_of(findings.frequency, "Hz")
    if natural is not None and natural.high - natural.low > thresholds.UNDETERMINED * natural.value:
        natural = None
    frequency_at = by_law
    if own_frequency is not None and (by_law is None or off or instead or narrower):
        frequency_at = own_frequency
    twins = possible_twins(findings, first)
    certain = findings.damping[first] >= thresholds.DECIDED and same and not twins
    decided = grade is not Grade.DEVIATES and certain and not (spring_doubtful or off)
    shares = [Share(t, q.value, q.low, q.high, findings.term[t]) for t, q in findings.energy.items()]
    # The parameters of the best damping and restoring law, but not those of the start of the motion and of the noise.
    law, terms = findings.best.restoring, [TERMS.get(t) for t in findings.best.damping]
    further = (name for t in terms for name in (t.parameter, *(p.name for p in t.inferred)))
    parameters = {*LAWS.get(law).parameters, *further}
    coefficients = tuple(
        Coefficient(n, q.value, q.sd_noise, q.sd_law, q.low, q.high, parameter_unit(n, law, unit))
        for n, q in findings.coefficients.items()
        if n in parameters
    )
    verdict = Verdict(
        record=record,
        grade=grade,
        decided=decided,
        damping=first,
        probability=damping[first],
        rivals=rivals_of(damping, {n: min(p, cap) for n, p in findings.other_forms.items()}),
        restoring=restoring,
        restoring_probability=min(next(iter(findings.restoring.values())), cap),
        frequency=natural,
        exponent=None if findings.exponent is None else interval_of(findings.exponent),
        damping_ratio=own_ratios if instead else ratios,
        energy=tuple(sorted(shares, key=lambda s: -s.share)),
        other_forms=(
            *(Bound(t, findings.bound[t]) for t in findings.bound if t not in first.split("+")),
            *([Bound("any other form", findings.other)] if approximate else []),
        ),
        deviation=interval_of(findings.deviation) if approximate else None,
        unexplained_pct=100 * findings.unexplained,
        noise_pct=100 * findings.noise,
        midline_drift_pct=100 * findings.midline,
        frequency_at=frequency_at,
        restoring_deviation=interval_of(findings.restoring_deviation) if approximate else None,
        law_free=instead,
        contradicted=contradicted,
        coefficients=coefficients,
        window=window,
        averages=averages,
        quantity=quantity,
        over_law=_over_law(findings, unit),
    )
    if instead:  # without a law, the energy of each term is not known
        verdict = replace(verdict, energy=(), other_forms=())
    if contradicted:
        verdict = replace(verdict, exponent=None, coefficients=())
    if off and q is not None and not instead:
        notes = [*notes, frequency_remark(verdict, interval_of(q, "Hz"))]
    if spring_doubtful:
        notes = [*notes, spring_remark(verdict, interval_of(findings.restoring_deviation))]
    reservations = remarks(verdict, findings, same, notes, twins)
    return replace(verdict, remarks=reservations, sentence=sentence(verdict))


def _with_intervals(law_free: LawFreeDamping, unit: str) -> tuple[tuple[DampingRatio, ...], FrequencyAt]:
    """Return damping ratios, and the frequency at the last of their amplitudes, with 95 % intervals.

    They are measured without assuming a law (`law_free`). Equal rows, for amplitudes beyond the same end of the
    measurement, are one. unit: unit of the amplitudes.
    """
    columns = np.column_stack((law_free.amplitude, law_free.ratio, law_free.ratio_sd)).tolist()
    ratios = tuple(
        DampingRatio(a, unit, r, sd, 0.0, r - NORMAL_95 * sd, r + NORMAL_95 * sd)
        for a, r, sd in dict.fromkeys(map(tuple, columns))
    )
    value, half = float(law_free.frequency[-1]), NORMAL_95 * float(law_free.frequency_sd[-1])
    return ratios, FrequencyAt(ratios[-1].amplitude, unit, value, value - half, value + half)


def possible_twins(findings: Findings, damping: str) -> tuple[tuple[str, str, float], ...]:
    """Return the terms of the sum `damping` whose twin cannot be excluded.

    A twin of a term is another term that dissipates the same energy as this term at every amplitude. It cannot be
    excluded if it is in a compared sum, is not in `damping`, and the 95 % upper limit of its energy fraction is at
    least `thresholds.TWIN`. Each result is (term, twin, this upper limit as a fraction); empty if there is none.
    """
    own = damping.split("+")
    return tuple(
        (term, twin, findings.bound[twin])
        for term, twin in twin_pairs(own, findings.term.keys() - set(own))
        if findings.bound.get(twin, 0.0) >= thresholds.TWIN
    )


def twin_pairs(terms: Iterable[str], others: Container[str]) -> list[tuple[str, str]]:
    """Return all pairs (term, twin) in which the term is in `terms` and its twin is in `others`.

    A twin of a damping term is another term with the same energy loss at every amplitude.
    """
    return [(term, twin) for term in terms for twin in twins_of(term) if twin in others]


def rivals_of(sums: Mapping[str, float], others: Mapping[str, float]) -> tuple[Rival, ...]:
    """Return all dampings except the one that the verdict names, with their probabilities, the most probable first.

    sums: probabilities of the compared damping sums, by name; the first is the named one. others: probabilities of
    forms of damping outside these sums, by name.
    """
    rivals = [Rival(n, p) for n, p in [*list(sums.items())[1:], *others.items()]]
    return tuple(sorted(rivals, key=lambda r: -r.probability))


def grade_of(findings: Findings) -> Grade:
    """Return the grade of how well the laws of damping and restoring force hold.

    It is `DEVIATES` in three cases: if the median of the deviation from the damping law is above `thresholds.DEVIATES`,
    if the 2.5 % quantile of the deviation from the restoring law is above `RESTORING_DEVIATES`, or if the unexplained
    residual is above `UNEXPLAINED`. Otherwise it is `EXACT` if the 97.5 % quantile of the deviation from the damping
    law is at most `thresholds.EXACT`, and else `APPROXIMATE`. All these numbers are fractions.
    """
    if (
        findings.deviation.value > thresholds.DEVIATES
        or findings.restoring_deviation.low > thresholds.RESTORING_DEVIATES
        or findings.unexplained > thresholds.UNEXPLAINED
    ):
        return Grade.DEVIATES
    return Grade.EXACT if findings.deviation.high <= thresholds.EXACT else Grade.APPROXIMATE


def _contradicts(law: Interval | FrequencyAt, own: DampingRatio | FrequencyAt, least: float) -> bool:
    """Return whether the value of a law, `law`, contradicts the value that is measured without a law, `own`.

    Both are at the same amplitude. They contradict each other if they differ by more than the fraction `least` of the
    measured value, and if their 95 % intervals do not overlap after the measured interval is widened by the factor
    `thresholds.WIDER`. The result is False for NaN.
    """
    low, high = (own.value + thresholds.WIDER * (end - own.value) for end in (own.low, own.high))
    return abs(law.value - own.value) > least * abs(own.value) and (law.low > high or law.high < low)


def interval_of(q: Quantity, unit: str = "") -> Interval:
    """Convert a `Quantity` (median and 95 % interval) to an `Interval` with this unit; the numbers are not changed."""
    return Interval(q.value, q.low, q.high, unit)


def _over_law(findings: Findings, unit: str) -> OverLaw | None:
    """Return the damping divided by that of its law, at the amplitude where it surely deviates most from its law.

    It surely deviates if the 95 % interval (low, high) of this ratio is above 1 + D or below 1/(1 + D), with D =
    `thresholds.DEVIATES`; the result is None if this is so at no amplitude. It deviates most where max(low, 1/high) is
    largest. The amplitudes are those of `findings.ratios`.
    """
    off = [
        (max(q.low, 1 / q.high), r.amplitude, q)
        for r, q in zip(findings.ratios, findings.over_law, strict=False)
        if max(q.low, 1 / q.high) > 1 + thresholds.DEVIATES
    ]
    if not off:
        return None
    _, amplitude, q = max(off, key=lambda item: item[0])
    return OverLaw(amplitude, unit, q.value, q.low, q.high)
