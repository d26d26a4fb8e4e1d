"""Decide on the verdict on an envelope (amplitude against time), and on several envelopes of one specimen."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import TypeVar

import numpy as np

from bayesdamp.inference.deviation.draws import quantity
from bayesdamp.inference.deviation.linear import DampingLikelihood, grid_of
from bayesdamp.inference.deviation.repeats import RecordLikelihood, join_runs
from bayesdamp.inference.deviation.specimen import SpecimenComparison
from bayesdamp.inference.envelope.candidates import KNOTS, EnvelopeCandidate
from bayesdamp.inference.envelope.decay import Curve, Decay
from bayesdamp.inference.envelope.posterior import (
    DRIFT,
    SENSOR,
    RateDraws,
    RateLikelihood,
    draw_rates,
    likelihood_of,
)
from bayesdamp.inference.envelope.sums import (
    Ranking,
    Sum,
    compare_sums,
    fit_power_law,
    indistinguishable,
    is_other_form,
    power_candidates,
    rank_sums,
)
from bayesdamp.numerics.weights import normalise
from bayesdamp.physics.amplitude import FORMS, POWERS, Scale, coefficient_from_rate, parameter
from bayesdamp.physics.damping import PAPER_TERMS, TERMS, twins_of
from bayesdamp.priors import SCORE_RATIO, SHARED_SCALES, SharedHalfNormal, odds
from bayesdamp.types import NORMAL_95, InputError
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.decide import interval_of, rivals_of
from bayesdamp.verdict.parts import (
    AtAmplitude,
    Coefficient,
    DampingRatio,
    Grade,
    Interval,
    MeasuredNumber,
    Share,
    UsedWindow,
)
from bayesdamp.verdict.specimen import common_verdict, pool_records, specimen_probabilities, spread_remark
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import at_middle, named, sentence, with_interval

FALL_FRACTIONS = (0.15, 0.5, 0.85)
"""Places in the decay of an envelope at which decay rates and Q are given: fractions of its total decrease in dB, from
its start (conventional)."""
Kind = TypeVar("Kind", bound=AtAmplitude)


@dataclass(frozen=True, eq=False)
class EnvelopeAnswer:
    """The answer on an envelope: verdict, curve and likelihoods.

    curve: the decay with its fit; None if there is no decay. likelihoods: for a joint fit of several records, the
    likelihood of the decay rates of a sum's terms, by name of the damping sum. Sums whose terms have parameters besides
    their coefficients, such as an exponent, are left out.
    """

    verdict: Verdict
    curve: Curve | None = None
    likelihoods: Mapping[str, RateLikelihood] = field(default_factory=dict)


def answer(decay: Decay, sums: Sequence[Sum], seed: int) -> EnvelopeAnswer:
    """Compare sums of damping terms on a decay; return the verdict, the decay with its fit, and rate likelihoods.

    The grade is `EXACT` if the probability that a damping law holds exactly is at least `thresholds.LIKELY_EXACT`. Else
    it is `APPROXIMATE` if the 97.5 % quantile of the deviation from the law (a fraction) is at most
    `thresholds.DEVIATES`, and otherwise `DEVIATES`. If a single power of the amplitude describes the decay much better
    than all sums (`thresholds.POWER_LAW`), the grade is `DEVIATES`, and the rates are drawn from this power law too. A
    damping is named without reservation under the conditions of `decide`; twins are here sums whose decays the record
    cannot distinguish (`indistinguishable`).

    Parameters
    ----------
    decay
        The decay of an envelope.
    sums
        Damping sums to compare, prepared for this decay (see `inference.envelope.decay.free_decay`).
    seed
        Seed of the random draws.
    """
    b = decay.blocks
    ranking = rank_sums(sums, compare_sums(b, sums))
    power = fit_power_law(b, ranking)
    rng = np.random.default_rng([seed, b.t.size])
    top, bottom = b.ends
    amplitudes = np.array([top + share * (bottom - top) for share in FALL_FRACTIONS])
    # Relative error of every rate because of the sensor; the record itself does not show it.
    sensor = float(np.hypot(SENSOR, DRIFT / (0.5 * decay.fall))) if decay.record.logarithmic else SENSOR

    def draw_twice(
        candidates: Sequence[EnvelopeCandidate], terms: Sequence[str]
    ) -> tuple[RateDraws, RateDraws]:
        """Draw decay rates twice: with deviations from the laws and the sensor's error, and without both."""
        whole = draw_rates(b, candidates, terms, amplitudes, rng, sensor)
        return whole, draw_rates(b, candidates, terms, amplitudes, rng, sensor=0.0, exact=True)

    by_laws = draw_twice(ranking.candidates, ranking.terms)
    deviation = interval_of(quantity(by_laws[0].deviation))
    twins = indistinguishable(ranking)
    inexact = Grade.APPROXIMATE if deviation.high <= thresholds.DEVIATES else Grade.DEVIATES
    grade = Grade.EXACT if ranking.exact >= thresholds.LIKELY_EXACT else inexact
    decided = ranking.by_sum[ranking.best.name] >= thresholds.DECIDED and ranking.best_exact is ranking.best
    by_sum = decided and grade is not Grade.DEVIATES
    one_power = power.odds > thresholds.POWER_LAW and b.t.size >= thresholds.FEW_READINGS and not by_sum
    whole, plain = by_laws
    if one_power and "power" not in ranking.terms:
        # No sum describes the record: draw the rates from the single power of the amplitude too.
        whole, plain = draw_twice([*ranking.candidates, *power_candidates(b)], (*ranking.terms, "power"))
    best, frequency, omega = ranking.best, decay.record.frequency, b.frequency
    damping = {name: min(p, thresholds.CAP) for name, p in ranking.by_sum.items()}
    first = damping.pop(best.name)
    unexplained, noise = decay.misfit(ranking.fitted.fit)
    record, used = decay.record, decay.window
    start, stop = float(record.t[used.start]), float(record.t[used.stop - 1])
    floor = float("nan") if used.floor is None else float(10.0 * np.log10(used.floor.power))
    cycles = (frequency or float("nan")) * (stop - start)
    energies = zip(ranking.by_term.items(), map(quantity, by_laws[0].energy.T), strict=True)

    def at(kind: type[Kind], of: Callable[[np.ndarray], np.ndarray]) -> tuple[Kind, ...]:
        """Return a quantity that depends on the decay rate, such as Q, with its 95 % interval at each amplitude.

        of: function that computes the quantity from draws of the rates in 1/s. kind: class of the results.
        """
        values = []
        for x, draws, exact in zip(amplitudes, of(whole.at).T, of(plain.at).T, strict=True):
            e = estimate_of(draws, exact)
            values.append(kind(*decay.amplitude(x), e.value, e.sd_noise, e.sd_law, e.low, e.high))
        return tuple(values)

    verdict = Verdict(
        record=record.name,
        grade=Grade.DEVIATES if one_power else grade,
        decided=by_sum and not twins,
        damping=best.name,
        probability=first,
        rivals=rivals_of({best.name: first, **damping}, {}),
        frequency=Interval(frequency, frequency, frequency, "Hz") if frequency else None,
        exponent=interval_of(power.exponent),
        damping_ratio=at(DampingRatio, lambda rates: rates / omega) if omega else (),
        energy=tuple(Share(term, q.value, q.low, q.high, p) for (term, p), q in energies),
        deviation=deviation,
        unexplained_pct=100 * unexplained,
        noise_pct=100 * noise,
        coefficients=_coefficients_of(decay, ranking, *by_laws),
        window=UsedWindow(start, stop, cycles, "; ".join(filter(None, used.why)), floor),
        quantity="envelope",
        rate=estimate_of(whole.whole, plain.whole, "1/s"),
        quality_factor=estimate_of(omega / 2 / whole.whole, omega / 2 / plain.whole) if omega else None,
        decay_rate=at(AtAmplitude, lambda rates: rates),
        quality_factor_at=at(AtAmplitude, lambda rates: omega / 2 / rates) if omega else (),
        probability_exact=ranking.exact,
        power_law=power.odds,
    )
    verdict = replace(verdict, remarks=_remarks(verdict, decay, ranking, twins), sentence=sentence(verdict))
    likelihoods = {
        c.name: likelihood_of(c, b, decay.reference)
        for c in ranking.candidates
        if c.name in {s.name for s in ranking.sums if not s.count}
    }
    return EnvelopeAnswer(verdict, decay.curve(*ranking.fitted.curve(b)), likelihoods)


def estimate_of(draws: np.ndarray, plain: np.ndarray, unit: str = "") -> MeasuredNumber:
    """Compute from draws (n,) of a number its median, its 95 % interval, and the parts of its standard deviation.

    plain: draws (m,) of the number that vary because of the noise of the readings only. Their standard deviation, but
    at most that of `draws`, is `sd_noise`. The other part is sd_law = √(sd² − sd_noise²), with the standard deviation
    sd of `draws`. unit: unit of the draws and the result.
    """
    q = quantity(draws, float(np.std(plain)))
    return MeasuredNumber(q.value, q.sd_noise, q.sd_law, q.low, q.high, unit)


def _coefficients_of(decay: Decay, ranking: Ranking, *draws: RateDraws) -> tuple[Coefficient, ...]:
    """Return the coefficients and further parameters of the terms in the most probable sum of damping terms.

    Each is averaged over all sums that contain the term. For a record in dB, whose amplitudes have no absolute scale,
    the coefficients are in units of the amplitude at the start. If the frequency is not known, viscous, Coulomb and
    quadratic damping have the coefficients of the amplitude's decay (`coefficient_from_rate`); for another term, the
    decay rate at the start, `rate_TERM`, replaces the coefficient; and further parameters whose unit contains a time
    are left out. draws: draws of the rates, first with deviations from the laws and the sensor's error, then without.
    """
    record, best, omega = decay.record, ranking.best, decay.blocks.frequency
    amplitude = float(np.exp(-best.start if record.logarithmic else decay.reference))
    unit = record.unit.replace("^2", "").replace("2", "")
    if record.logarithmic or record.unit.endswith("W"):
        unit = "A_start" if record.logarithmic else f"√{record.unit}"
    scale = Scale(amplitude * float(np.exp(best.start)), omega or 1.0)
    own_unit = unit
    if best.scale.amplitude != 1.0:  # the record's amplitudes have an absolute scale
        scale = Scale(best.scale.amplitude, scale.frequency)
        own_unit = "rad" if unit in ("rad", "mrad", "deg") else "m"
    sums = {s.name: s for s in ranking.sums}
    results: list[Coefficient] = []

    def add(name: str, unit: str, values: Callable[[RateDraws], np.ndarray]) -> None:
        """Append a parameter to the results; `values` computes it from draws of the rates.

        If there are no draws under exact laws, the draws with deviations are used in their place.
        """
        whole, exact = map(values, draws)
        results.append(Coefficient(name, *astuple(estimate_of(whole, exact if exact.size else whole, unit))))

    for place, term in enumerate(best.terms):
        if term in POWERS:
            name, _, of = coefficient_from_rate(term, np.empty(0), amplitude, omega)

            def coefficient(d: RateDraws, term: str = term) -> np.ndarray:
                return coefficient_from_rate(term, d.rates[term], amplitude, omega)[1]

            add(name, of.format(unit), coefficient)
            continue
        # By index of the candidate: scores of the term's parameters, and the term's coefficient per decay rate.
        scores, factors = {}, {}
        for k, c in enumerate(ranking.candidates):
            if term in c.terms:
                at, sum_ = c.terms.index(term), sums[c.name]
                scores[k] = sum_.scores_of(c.scores, at)
                log_factor = -sum_.unit_rate(at, scores[k], scale)
                if omega is None:
                    log_factor = np.log(c.law.shapes(np.array([sum_.start]))[at, 0])
                factors[k] = float(np.exp(log_factor))

        def each(d: RateDraws, values: Mapping[int, float]) -> np.ndarray:
            """Return for each draw the value of its candidate; draws whose candidate has no value are left out.

            values: the values, by index of the candidate.
            """
            return np.array([values[k] for k in d.candidate.tolist() if k in values])

        kind = best.each[place]
        name, of = (kind.parameter, kind.unit) if omega is not None else (f"rate_{term}", "1/s")
        add(name, of.replace("rad", own_unit), lambda d, f=factors, t=term: each(d, f) * d.rates[t])
        for i, p in enumerate(kind.inferred):
            if omega is not None or "s" not in p.unit.replace("rad", ""):
                values = {k: parameter(p, z[i], scale) for k, z in scores.items()}
                add(p.name, p.unit.replace("rad", own_unit), lambda d, values=values: each(d, values))
    return tuple(results)


def _remarks(v: Verdict, decay: Decay, ranking: Ranking, twins: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """Return the sentences with remarks on an envelope's verdict.

    twins: pairs of names of damping sums that the record cannot distinguish.
    """
    record = decay.record
    texts = list(record.notes)
    if record.frequency is None:
        texts.append(
            "The frequency is not known, so rates are given but no Q; give --frequency HZ, or a line "
            "`% Frequency [Hz]: ...` in the file."
        )
    if record.logarithmic:
        paper = all(term in PAPER_TERMS for term in ranking.terms)
        which = "Coulomb and quadratic" if paper else "all but viscous"
        texts.append(
            f"Amplitudes have no scale: {which} coefficients are relative to the amplitude at the start."
        )
    for term in v.damping.split("+"):
        alternatives = " or ".join(named(twin) for twin in twins_of(term))
        if alternatives:
            texts.append(
                f"An envelope cannot distinguish {named(term)} damping from {alternatives} damping, which lose the "
                f"same at every amplitude: any part of the {named(term)} damping may be {alternatives}."
            )
    for first, second in twins:
        texts.append(
            f"An envelope cannot distinguish {named(first)} damping from {named(second)} damping here, which lose the "
            "same at every amplitude: their probabilities are just the prior ones."
        )
    if ranking.best_exact is not ranking.best:
        best = named(ranking.best_exact.name)
        texts.append(f"If the damping followed its law exactly, {best} would be the most probable damping.")
    if decay.readings < thresholds.FEW_READINGS:
        texts.append(f"There are only {decay.readings} readings, so the noise is hardly known.")
    if decay.fall < thresholds.SHALLOW:
        texts.append(
            f"The level falls by only {decay.fall:.1f} dB; below {thresholds.SHALLOW:g} dB damping models are hard to "
            "distinguish."
        )
    if v.window is not None and not np.isfinite(v.window.floor_db):
        texts.append(
            "No noise floor was found after the decay, so the noise power is inferred from the decay alone."
        )
    if v.power_law > thresholds.POWER_LAW and not v.decided and decay.readings >= thresholds.FEW_READINGS:
        texts.append(
            "A single power law of the amplitude describes the decay better than every sum of damping terms, so the "
            "rates are computed from it. Use --damping power to compare it with the sums."
        )
    return tuple(texts)


def shared_likelihoods(answers: Sequence[EnvelopeAnswer]) -> dict[str, tuple[DampingLikelihood, ...]]:
    """Return the likelihoods of the records of a specimen, for each sum of damping terms compared on all of them.

    The result contains, by name of the sum, one likelihood for each record with a decay. Sums whose terms have inferred
    parameters besides their coefficients are left out. It is empty if no record has a decay, or no sum is left.

    The likelihood of a record is a function of the scores of the sum's terms. The score of a term is its damping ratio
    at a reference amplitude, divided by `SCORE_RATIO`. The reference amplitude is the geometric mean of the records'
    own reference amplitudes. If the frequency of any record is not known, the score is the term's decay rate at this
    amplitude times the geometric mean of the records' durations, times a constant.
    """
    records = [a.likelihoods for a in answers if a.likelihoods]
    if not records:
        return {}
    firsts = [next(iter(likelihoods.values())) for likelihoods in records]
    log_amplitude = float(np.mean([likelihood.reference for likelihood in firsts]))
    omegas = [likelihood.omega for likelihood in firsts]
    if None not in omegas:
        rates = [SCORE_RATIO * float(omega or 1.0) for omega in omegas]
    else:
        middle = float(np.sqrt(SHARED_SCALES[0] * SHARED_SCALES[-1]))
        time = float(np.exp(np.mean(np.log([likelihood.duration for likelihood in firsts]))))
        rates = [SCORE_RATIO / (time * middle)] * len(firsts)
    return {
        name: tuple(
            DampingLikelihood(*likelihoods[name].in_scores(log_amplitude, rate))
            for likelihoods, rate in zip(records, rates, strict=True)
        )
        for name in records[0]
        if all(name in likelihoods for likelihoods in records)
    }


def joint_damping(answers: Sequence[EnvelopeAnswer]) -> SpecimenComparison | None:
    """Compare sums of damping terms on all records of a specimen together; return None if fewer than two have a decay.

    The result contains the probability and the joint posterior of each sum. It is also None if `shared_likelihoods`
    contains no sum. All records have the same coefficients, times a factor for each record. The log deviation g of the
    damping from its law is inferred for each record, but its size and correlation length are common to all.
    """
    by_sum = shared_likelihoods(answers)
    if not by_sum or len(next(iter(by_sum.values()))) < 2:
        return None
    logs, repeats = {}, {}
    for name, likelihoods in by_sum.items():
        terms = name.split("+")
        priors = {t: SharedHalfNormal(1.0) for t in terms}
        ones = np.ones(len(terms))
        runs = [RecordLikelihood.of_scores(priors, terms, ones, likelihood) for likelihood in likelihoods]
        model = name, ""
        repeats[model] = join_runs(runs, priors, grid_of(KNOTS, phases=False).log_prior, seed=0)
        other = is_other_form(tuple(terms), [tuple(n.split("+")) for n in by_sum])
        logs[model] = repeats[model].log_evidence + float(np.log(odds(terms, other, len(FORMS))))
    share = dict(zip(logs, normalise(np.array(list(logs.values()))).tolist(), strict=True))
    return SpecimenComparison((), logs, share, repeats, {})


def at_common_amplitudes(
    records: Sequence[Sequence[AtAmplitude]],
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Interpolate a number of several records at three amplitudes in the range that all of them have in common.

    Parameters
    ----------
    records
        The number at three amplitudes of each of n records, the largest amplitude first.

    Returns
    -------
    list of tuple
        For each amplitude, the largest first: the amplitude in the records' unit, ln of the records' numbers there,
        (n,), and the standard deviation of this logarithm, (n,). Empty if the records have no amplitudes in common. The
        amplitudes are both ends and the middle of the common range (the geometric mean of the ends; for levels in dB
        the arithmetic mean).
    """
    level = records[0][0].unit.startswith("dB")
    curves = []
    for rows in records:
        a = np.array([r.amplitude for r in rows[::-1]])
        values = np.array([r.value for r in rows[::-1]])
        sd = np.array([np.hypot(r.sd_noise, r.sd_law) for r in rows[::-1]]) / values
        curves.append((a if level else np.log(a), np.log(values), sd))
    low, high = max(a[0] for a, _, _ in curves), min(a[-1] for a, _, _ in curves)
    results = []
    for at in (high, 0.5 * (low + high), low) if low < high else ():
        # Interpolate by the parabola through the three values: a power law is a straight line in these coordinates, and
        # a sum of terms is nearly straight.
        x = np.array([np.polyfit(a - at, y, 2)[-1] for a, y, _ in curves])
        sd = np.array([np.interp(at, a, sd) for a, _, sd in curves])
        results.append((float(at if level else np.exp(at)), x, sd))
    return results


def specimen(name: str, answers: Sequence[EnvelopeAnswer]) -> Verdict | None:
    """Return the verdict on a specimen from the answers on its envelopes; None if fewer than two of them have a decay.

    The common Q is exp of the mean of ln Q over the records, whose ln Q may differ by a normal random effect
    (`pool_records`). If the frequency of a record is unknown, the decay rate is used instead of Q. Unless the damping
    is viscous with a probability of at least `thresholds.DECIDED`, Q is assumed to depend on the amplitude. The common
    Q is then computed at three amplitudes that all records have in common, and `quality_factor` or `rate` is that at
    the middle one. Without common amplitudes it is computed from the mean Q of each record, and a remark says so.

    Sums whose terms have parameters besides their coefficients cannot be compared on all records together. If one was
    compared, the damping is "", and a remark gives that of each record; unless it was the only sum.

    Parameters
    ----------
    name
        Name of the specimen.
    answers
        Answers on its envelopes.

    Raises
    ------
    InputError
        If the records have different units.
    """
    own = [a.verdict for a in answers if a.verdict.rate is not None]
    quality = all(v.quality_factor is not None for v in own)
    values = [e for v in own if (e := v.quality_factor if quality else v.rate) is not None]
    if len(values) < 2:
        return None
    units = dict.fromkeys(v.decay_rate[0].unit for v in own)
    if len(units) > 1:
        raise InputError(
            f"records of one specimen are in {' and '.join(units)}; record all of them in one unit to compare them"
        )
    compared = {name for v in own for name in v.probabilities}
    further = any(TERMS.get(term).inferred for name in compared for term in name.split("+"))
    joint = None if further else joint_damping(answers)
    alone = dict.fromkeys(compared, 1.0) if len(compared) == 1 else {"": float("nan")}
    damping = specimen_probabilities(joint)[0] if joint else alone
    varies = not damping.get("viscous", 0.0) >= thresholds.DECIDED
    rates = at_common_amplitudes([v.decay_rate for v in own]) if varies else []
    qualities = at_common_amplitudes([v.quality_factor_at for v in own]) if varies and quality else []
    unit, at = values[0].unit, own[0].decay_rate[0].unit if rates else ""

    def pooled(x: np.ndarray, sd: np.ndarray, unit: str) -> MeasuredNumber:
        """Return the mean over the records of a number in `unit`, from its logarithms x (n,) and their sds (n,)."""
        p = pool_records(x, sd)
        value, alone = float(np.exp(p.mean)), min(float(np.sum(sd**-2.0) ** -0.5), p.sd)
        low, high = np.exp([p.mean - NORMAL_95 * p.sd, p.mean + NORMAL_95 * p.sd]).tolist()
        between = value * float((p.sd**2 - alone**2) ** 0.5)
        return MeasuredNumber(value, value * alone, between, low, high, unit)

    def table(rows: Sequence[tuple[float, np.ndarray, np.ndarray]]) -> tuple[AtAmplitude, ...]:
        return tuple(AtAmplitude(a, at, *astuple(pooled(x, sd, ""))[:-1]) for a, x, sd in rows)

    x = np.log([e.value for e in values])
    sd = np.array([np.hypot(e.sd_noise, e.sd_law) / e.value for e in values])
    if rates:
        _, x, sd = (qualities or rates)[1]
    p, common = pool_records(x, sd), pooled(x, sd, unit)
    next_low, next_high = np.exp([p.low, p.high]).tolist()
    verdict = replace(
        common_verdict(name, own, {n: min(share, thresholds.CAP) for n, share in damping.items()}, {}),
        spread=Interval(*joint.spread()) if joint else Interval(p.spread, p.spread_low, p.spread_high),
        rate=None if quality else common,
        quality_factor=common if quality else None,
        decay_rate=table(rates),
        quality_factor_at=table(qualities),
        next_value=Interval(common.value, next_low, next_high, unit),
    )
    what, where = "Q" if quality else "decay rate", at_middle(verdict)
    more = with_interval(common.value, next_low, next_high, f" {unit}" if unit else "")
    texts = (
        *spread_remark(verdict),
        f"One more record would have {what} = {more}{where} with 95 % probability.",
        *verdict.remarks,
    )
    if varies and not rates:
        texts = (
            f"The records have no amplitude in common, so the common {what} is an average of the mean {what} of each "
            "record. These means are at different amplitudes, and differ if the damping depends on the amplitude.",
            *texts,
        )
    return replace(verdict, remarks=texts, sentence=sentence(verdict))
