"""Decide on the verdict on a specimen (one object in several records), and compare two verdicts on one record."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.formatting import digits, listing, percentage, with_interval
from bayesdamp.inference.deviation.draws import law_part, quantity
from bayesdamp.inference.deviation.findings import SENSOR
from bayesdamp.inference.deviation.specimen import RunComparison, SpecimenComparison, compare_runs
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.priors import Prior
from bayesdamp.types import NORMAL_95, candidate_name, sum_probabilities
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.decide import rivals_of, twin_pairs
from bayesdamp.verdict.parts import NAN, Coefficient, DampingRatio, Grade, Interval, Share
from bayesdamp.verdict.thresholds import AGREEMENT_SDS, WIDTHS_AGREE
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import named, sentence, spring_is_doubtful, twin_remark

SPREAD_VALUES = 400
"""Number of values of the standard deviation between records in the numerical integration of `pool_records`."""
PRIOR_SCATTERS = 2.0
"""The standard deviation between records has a half-Cauchy prior. Its scale is this factor times the standard deviation
of the records' values, or times their median standard error if that is larger (weakly informative; Gelman 2006)."""
RATIO_DRAWS = 20_000
"""Number of draws of a specimen's damping ratio; the ends of the 95 % interval are then accurate to 2 % of its
width."""
LEAST_COMMON = 0.5
"""Records of a specimen have a common verdict only if the models that were fitted to all of them have at least this
probability together (conventional). Otherwise a record excludes the damping of the others."""
TINIEST = 1e-60
"""Smallest standard error in `pool_records`, in the unit of the number; it only avoids divisions by 0."""
Curve = Mapping[str, np.ndarray]
"""Type of a damping curve: arrays by name, such as `amplitude` and `ratio`, which have one element for each point."""


@dataclass(frozen=True)
class PooledMean:
    """The mean of a number over records, and the spread between records.

    mean, sd: posterior mean and standard deviation of the common mean. spread, spread_low, spread_high: posterior
    median of the standard deviation between records, with its 95 % interval. low, high: 95 % interval of the measured
    value of one more record, whose standard error is the median of the records' standard errors. All are in the unit of
    the number.
    """

    mean: float
    sd: float
    spread: float
    spread_low: float
    spread_high: float
    low: float
    high: float


def pool_records(values: np.ndarray, sds: np.ndarray) -> PooledMean:
    """Infer the mean of a number over several records, and the spread between them, from the records' values.

    The result also contains an interval for one more record (see `PooledMean`). The true values of the records differ
    by a normal random effect, whose standard deviation is the spread. The spread has a half-Cauchy prior (for its
    scale, see `PRIOR_SCATTERS`), and the mean has a flat prior. For a single record the spread is 0.

    Parameters
    ----------
    values, sds
        Values of the records and their standard errors, (n,) each, in the unit of the number.
    """
    values, sds = np.asarray(values, float), np.asarray(sds, float)
    sds = np.maximum(sds, max(1e-12 * np.abs(values).max(), TINIEST))
    if values.size == 1:
        v, s = float(values[0]), float(sds[0])
        return PooledMean(v, s, 0.0, 0.0, 0.0, v - NORMAL_95 * s, v + NORMAL_95 * s)
    scale = PRIOR_SCATTERS * max(float(np.std(values)), float(np.median(sds)))
    spreads = np.concatenate([[0.0], np.geomspace(1e-3, 20.0, SPREAD_VALUES - 1) * scale])
    precision = 1.0 / (sds**2 + spreads[:, None] ** 2)
    total = precision.sum(axis=1)
    means = precision @ values / total
    log = 0.5 * np.log(precision).sum(axis=1) - 0.5 * np.log(total)
    log -= 0.5 * np.sum(precision * (values - means[:, None]) ** 2, axis=1)
    log -= np.log1p((spreads / scale) ** 2)
    weight = np.exp(log - log.max()) * np.gradient(spreads)
    weight /= weight.sum()
    mean = float(weight @ means)
    sd = float(np.sqrt(weight @ (1 / total + (means - mean) ** 2)))
    cumulative = np.cumsum(weight)
    spread, below, above = (float(np.interp(q, cumulative, spreads)) for q in (0.5, 0.025, 0.975))
    if not np.isfinite(sd):
        return PooledMean(mean, sd, spread, below, above, np.nan, np.nan)
    width = np.sqrt(1 / total + spreads**2 + np.median(sds) ** 2)
    outside = float(np.min(means - 9 * width)), float(np.max(means + 9 * width))

    def excess(x: float, q: float) -> float:
        """Return the cumulative probability minus q at x, for the value of one more record.

        Its distribution is a mixture of normal distributions.
        """
        return float(weight @ scipy.special.ndtr((x - means) / width)) - q

    ends = (scipy.optimize.brentq(excess, *outside, (q,), xtol=1e-12 * sd) for q in (0.025, 0.975))
    return PooledMean(mean, sd, spread, below, above, *ends)


@dataclass(frozen=True)
class RecordAnswer:
    """The answer on one record: its verdict, its comparison of dampings, and its damping curve.

    curve: arrays `amplitude` (in the base unit), `ratio` (damping ratio, a fraction), `low` and `high` (ends of its 95
    % interval). `ratio`, `low` and `high` are missing if no law is the answer (`verdict.law_free`). If deviations from
    the laws are allowed, also `over` and `over_sd`: mean and standard deviation of ln(damping ratio / damping ratio
    without deviations from the law).
    """

    verdict: Verdict
    comparison: RunComparison
    curve: Curve


def specimen(
    name: str,
    records: Sequence[RecordAnswer],
    priors: Mapping[str, Prior] | None = None,
    sensor: float = SENSOR,
    seed: int = 0,
    amplitudes: Sequence[float] | None = None,
) -> Verdict:
    """Return the verdict on a specimen (one object that was recorded several times) from the answers on its records.

    All records have the same damping, times a factor for each record, whose spread is inferred. The verdict has the
    grade `NOT_WEIGHED` if the models that were fitted to all records are improbable (`LEAST_COMMON`), no coefficients
    if a record contradicts its law, and no natural frequency if those of the records differ
    (`thresholds.FREQUENCIES_DIFFER`).

    Parameters
    ----------
    name
        Name of the specimen.
    records
        Answers on its records.
    priors
        Specified priors of the damping terms' parameters, by parameter; the others have default priors.
    sensor
        Relative linearity error of the sensor (sd; 0.002 by default). It is the same in all records, so that a mean
        over the records does not reduce it. It has no effect if the laws of a record were assumed to hold exactly.
    seed
        Seed of the random draws.
    amplitudes
        Amplitudes, in the base unit (rad, m or the sensor's), at which to give the damping ratio; by default those that
        `choose_amplitudes` returns. At an amplitude outside the ranges of all records the ratio is extrapolated, and a
        remark says so.

    Returns
    -------
    Verdict
        The verdict, with amplitudes in the base unit.

    Raises
    ------
    ValueError
        If there is no record.
    """
    if not records:
        raise ValueError("a specimen needs at least one record with a verdict")
    comparison = compare_runs([r.comparison for r in records], priors, seed=seed)
    own = [r.verdict for r in records]
    if sum(comparison.probability[m] for m in comparison.repeats) < LEAST_COMMON:
        groups: dict[str, list[str]] = {}
        for v in own:
            groups.setdefault(max(v.probabilities, key=v.probabilities.__getitem__), []).append(v.record)
        each = "; ".join(f"{named(damping)} in {listing(names)}" for damping, names in groups.items())
        reason = (
            f"The records do not have one damping in common. The most probable damping of each by itself: {each}. "
            "Compare them separately, or leave out those that differ."
        )
        kind = own[0].quantity
        return Verdict(name, Grade.NOT_WEIGHED, False, "", NAN, quantity=kind, sentence=reason)
    damping, restoring, others = specimen_probabilities(comparison)
    ranges = [(float(r.curve["amplitude"].min()), float(r.curve["amplitude"].max())) for r in records]
    amplitudes = choose_amplitudes(ranges) if amplitudes is None else amplitudes
    reaching = [[i for i, (low, high) in enumerate(ranges) if low <= a <= high] for a in amplitudes]
    unit = next((v.damping_ratio[0].unit for v in own if v.damping_ratio), "rad")
    by_amplitude = dict(zip(amplitudes, reaching, strict=True))
    ratios, following = _ratios(records, comparison, by_amplitude, unit, sensor, seed)
    partial = ""
    if min(map(len, reaching)) < len(records):
        partial = (
            f"Not all of the {len(records)} records reach these amplitudes. From the first amplitude to the last, the "
            f"number of records that do is {', '.join(str(len(r)) for r in reaching)}. The damping ratio is a mean "
            f"over these{'' if all(reaching) else '; where there are none, it is extrapolated from all'}."
        )
    known = [v.frequency for v in own if v.frequency is not None]
    frequency = known[0] if known else None
    differ = ""
    if known and max(i.low for i in known) > thresholds.FREQUENCIES_DIFFER * min(i.high for i in known):
        frequency, each = None, sorted(i.value for i in known)
        differ = (
            f"The natural frequencies of the records differ, from {digits(each[0], n=3)} to "
            f"{digits(each[-1], n=3)} {known[0].unit}, so "
            "no common one is given. The damping ratio is a mean over the records; if they are of different "
            "specimens, it is that of none of them: then compare the records separately."
        )
    elif known and not all(i.low == i.high == known[0].value for i in known):  # else it was specified
        sds = [(i.high - i.low) / (2 * NORMAL_95) for i in known]
        p = pool_records(np.array([i.value for i in known]), np.array(sds))
        frequency = Interval(p.mean, p.mean - NORMAL_95 * p.sd, p.mean + NORMAL_95 * p.sd, known[0].unit)
    verdict = replace(
        common_verdict(name, own, damping, others),
        restoring=next(iter(restoring)),
        restoring_probability=min(next(iter(restoring.values())), thresholds.CAP),
        frequency=frequency,
        damping_ratio=ratios,
        next_record=following,
        coefficients=()
        if any(v.contradicted for v in own)
        else coefficients_of(comparison, next(iter(damping)), unit),
        spread=Interval(*comparison.spread()) if len(records) > 1 else None,
    )
    rising = sorted(following, key=lambda r: r.amplitude)
    place, r = ("middle", rising[len(rising) // 2]) if len(rising) % 2 else ("smallest", rising[0])
    ratio = with_interval(r.value, r.low, r.high, " %", 100)
    more = f"One more record would have a damping ratio of {ratio} at the {place} amplitude, with 95 % probability."
    texts = (*filter(None, (differ, partial)), *spread_remark(verdict), more, *verdict.remarks)
    return replace(verdict, remarks=texts, sentence=sentence(verdict))


def common_verdict(
    name: str, own: Sequence[Verdict], damping: Mapping[str, float], others: Mapping[str, float]
) -> Verdict:
    """Return a specimen's verdict with the fields that do not depend on the kind of its records (motions or envelopes).

    One damping is named without reservation (`decided`) if its probability is at least `thresholds.DECIDED`, the grade
    is not `DEVIATES`, no record's spring is doubtful (`spring_is_doubtful`), and no twin of its terms is possible. A
    twin is another term with the same energy loss at every amplitude; it is possible if no record excludes it.

    The grade is the worst grade of all records. The deviation is the one with the largest upper limit, and the
    unexplained residual is the largest one. The energy fractions and the noise are medians over the records. The
    interval of an energy fraction extends from the smallest lower end to the largest upper end of all records.

    Parameters
    ----------
    name
        Name of the specimen.
    own
        The verdicts on its records.
    damping
        Probability of each compared damping sum from all records together, by name, the most probable first.
    others
        Probabilities of forms of damping outside the compared sums, by name.
    """
    first, probability = next(iter(damping.items()))
    grade = max((v.grade for v in own), key=list(Grade).index)
    doubtful = any(spring_is_doubtful(v.restoring, v.restoring_deviation) for v in own)
    shares = []
    for term in dict.fromkeys(s.term for v in own for s in v.energy):
        each = [s for v in own for s in v.energy if s.term == term]
        # Without a common comparison, the only probability is nan, under the name "".
        present = sum(p for sum_name, p in damping.items() if term in (sum_name or term).split("+"))
        middle = float(np.median([s.share for s in each]))
        shares.append(Share(term, middle, min(s.low for s in each), max(s.high for s in each), present))
    terms = first.split("+")
    compared = {t for name in damping for t in name.split("+")} - set(terms)
    # For each record, upper limits of the energy fractions of its terms and of other forms of damping.
    each = [{b.form: b.share_below for b in v.other_forms} | {s.term: s.high for s in v.energy} for v in own]
    limits = {pair: min(e.get(pair[1], 0.0) for e in each) for pair in twin_pairs(terms, compared)}
    twins = {pair: limit for pair, limit in limits.items() if limit >= thresholds.TWIN}
    every = {**damping, **others}
    likeliest = max(every, key=every.__getitem__)
    alone = Counter(max(v.probabilities, key=v.probabilities.__getitem__) for v in own)
    remarks = tuple(twin_remark(*pair, limit, len(own)) for pair, limit in twins.items())
    if set(alone) != {likeliest}:
        counts = ", ".join(f"{named(n)} in {count}" for n, count in alone.most_common())
        remarks += (f"The most probable damping of the records, each by itself: {counts}.",)
    return Verdict(
        record=name,
        grade=grade,
        decided=probability >= thresholds.DECIDED and grade is not Grade.DEVIATES and not (twins or doubtful),
        damping=first,
        probability=min(probability, thresholds.CAP),
        rivals=tuple(
            replace(r, probability=min(r.probability, thresholds.CAP)) for r in rivals_of(damping, others)
        ),
        energy=tuple(sorted(shares, key=lambda s: -s.share)),
        deviation=max(
            (v.deviation for v in own if v.deviation), key=lambda i: (i.high, i.value), default=None
        ),
        unexplained_pct=max(v.unexplained_pct for v in own),
        noise_pct=float(np.median([v.noise_pct for v in own])),
        remarks=remarks,
        records=len(own),
        quantity=own[0].quantity,
    )


def specimen_probabilities(
    comparison: SpecimenComparison,
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Return the probabilities of sums of damping terms, restoring laws and other forms, for all records together.

    Other forms are forms of damping outside the compared sums. Each result is a dictionary by name. In those of the
    sums and of the laws, the most probable one is first. The probability of a restoring law is summed over all
    dampings, including other forms.
    """
    others = comparison.others()
    every = {candidate_name(*model): p for model, p in comparison.probability.items()}
    sums = {n: p for n, p in sum_probabilities(every).items() if n not in others}
    return sums, sum_probabilities(every, part=1), others


def coefficients_of(comparison: SpecimenComparison, damping: str, unit: str) -> tuple[Coefficient, ...]:
    """Return the parameters of a sum of damping terms that all records of a specimen have in common.

    They are from the joint posterior of all records with the restoring law that is most probable with this sum. The
    result is empty if there is no joint posterior of this sum. `sd_noise` and `sd_law` of each are NaN. unit: base unit
    of the records.
    """
    models = [m for m in comparison.repeats if m[0] == damping]
    if not models:
        return ()
    model = max(models, key=lambda m: comparison.probability[m])
    repeats = comparison.repeats[model]
    results = []
    for name, draws in zip(repeats.names, repeats.draws.T, strict=True):
        q, own_unit = quantity(draws), parameter_unit(name, model[1], unit)
        results.append(Coefficient(name, q.value, NAN, NAN, q.low, q.high, own_unit))
    return tuple(results)


def pool_coefficients(specimens: Sequence[Verdict]) -> list[tuple[Coefficient, PooledMean]]:
    """Return the mean and spread of each damping coefficient over several specimens.

    Each result is the coefficient of the first specimen with the `PooledMean` over all specimens. The list is empty if
    there are fewer than two specimens, if their dampings or restoring laws differ or are not known, or if a specimen
    lacks a coefficient or has it in another unit. It is also empty for envelopes, because their coefficients may be
    relative to the amplitude at the start of each envelope.
    """
    models = {(v.damping, v.restoring, v.quantity == "envelope") for v in specimens}
    if (
        len(specimens) < 2
        or len(models) > 1
        or not specimens[0].damping
        or specimens[0].quantity == "envelope"
    ):
        return []
    results = []
    for name in [TERMS.get(t).parameter for t in specimens[0].damping.split("+")]:
        own = [c for v in specimens for c in v.coefficients if c.name == name]
        if len(own) < len(specimens) or len({c.unit for c in own}) > 1:
            return []
        sds = [(c.high - c.low) / (2 * NORMAL_95) for c in own]
        results.append((own[0], pool_records(np.array([c.value for c in own]), np.array(sds))))
    return results


def spread_remark(v: Verdict) -> tuple[str, ...]:
    """Return the remark on how much the damping differs between records; an empty tuple if this was not inferred."""
    if v.spread is None:
        return ()
    value, low, high = (percentage(x) for x in (v.spread.value, v.spread.low, v.spread.high))
    return (
        f"The damping differs between records by {value} % (standard deviation; 95 %: {low} to {high} %).",
    )


def choose_amplitudes(ranges: Sequence[tuple[float, float]]) -> list[float]:
    """Return up to three falling amplitudes at which to give the damping ratio of a specimen.

    They are at 10, 50 and 90 % of the way from the upper to the lower end of the range that all records have in common,
    on a logarithmic scale. If the records have no range in common, the geometric mean of the ends of each record's
    range is computed; the result is the largest, the median and the smallest of these means.

    Parameters
    ----------
    ranges
        The smallest and the largest amplitude of each record. All are in the same unit, as the result.
    """
    low, high = max(r[0] for r in ranges), min(r[1] for r in ranges)
    if low < high:
        return (high * np.exp(-np.log(high / low) * np.array([0.1, 0.5, 0.9]))).tolist()
    middles = sorted({float(np.sqrt(low * high)) for low, high in ranges}, reverse=True)
    return [middles[i] for i in sorted({0, len(middles) // 2, len(middles) - 1})]


def _ratios(
    records: Sequence[RecordAnswer],
    comparison: SpecimenComparison,
    reaching: Mapping[float, Sequence[int]],
    unit: str,
    sensor: float,
    seed: int,
) -> tuple[tuple[DampingRatio, ...], tuple[DampingRatio, ...]]:
    """Return the damping ratios of the specimen, and those that one more record would have, at several amplitudes.

    `reaching` maps each amplitude, in `unit`, to the indices of the records whose range contains it. Only these records
    are used at this amplitude, or all records if there are none. The damping ratio without deviations from the law is
    drawn from the joint posterior; its sd is `sd_noise` of the results, and `sd_law` is the rest: deviations, sensor
    and, for one more record, the random differences between records. The deviation is the mean over the records
    (`pool_records`). The sensor's error `sensor` is added only if laws may hold approximately.
    """
    approximate = all("over" in r.curve for r in records)
    specimen_rows, following_rows = [], []
    for row, (amplitude, numbers) in enumerate(reaching.items()):
        used = numbers or range(len(records))
        rng = np.random.default_rng([seed, row])
        law, spreads = comparison.ratios(amplitude, used, RATIO_DRAWS, seed)
        own = law.copy()
        scatter = np.zeros(RATIO_DRAWS)
        if approximate:
            over = []
            for curve in (records[i].curve for i in used):
                order = np.argsort(curve["amplitude"])
                x = np.log(curve["amplitude"][order])
                over.append([np.interp(np.log(amplitude), x, curve[n][order]) for n in ("over", "over_sd")])
            p = pool_records(*np.array(over).T)
            own = own * np.exp(p.mean + p.sd * rng.standard_normal(RATIO_DRAWS))
            scatter = np.full(RATIO_DRAWS, p.spread)
        own = own * (1 + (sensor if approximate else 0.0) * rng.standard_normal(RATIO_DRAWS))
        more = own * np.exp(np.hypot(spreads, scatter) * rng.standard_normal(RATIO_DRAWS))
        noise = float(np.std(law))
        for draws, rows in ((own, specimen_rows), (more, following_rows)):
            value, low, high = (float(q) for q in np.quantile(draws, (0.5, 0.025, 0.975)))
            rest = law_part(float(np.var(draws)), noise)
            rows.append(DampingRatio(amplitude, unit, value, noise, rest, low, high))
    return tuple(specimen_rows), tuple(following_rows)


@dataclass(frozen=True)
class Agreement:
    """How well a second verdict on a record agrees with the first.

    same: True in two cases: both verdicts decide on a damping (`Verdict.decided`) and it consists of the same terms, or
    neither verdict decides on a damping. moved: difference between the damping ratios of both verdicts at the amplitude
    at which it is largest. Its unit is the total standard deviation of the first verdict's ratio (the width of the 95 %
    interval, divided by 3.92). It is 0 if either verdict has no damping ratios.
    """

    same: bool
    moved: float

    @property
    def confirms(self) -> bool:
        """Return whether the damping is the same and every ratio differs by less than `AGREEMENT_SDS` (0.5 sd)."""
        return self.same and self.moved < AGREEMENT_SDS


@dataclass(frozen=True)
class RatioAgreement:
    """How well another computation of a damping ratio agrees with the verdict, at one amplitude.

    amplitude: in the unit of the verdict. moved: difference between the two values; its unit is the total standard
    deviation of the verdict's ratio (the width of the 95 % interval, divided by 3.92). wider: width of the other
    computation's 95 % interval divided by the width of the verdict's.
    """

    amplitude: float
    moved: float
    wider: float

    @property
    def confirms(self) -> bool:
        """Return whether `moved` is below `AGREEMENT_SDS`, and `wider` and 1/`wider` are below `WIDTHS_AGREE`."""
        return self.moved < AGREEMENT_SDS and 1 / WIDTHS_AGREE < self.wider < WIDTHS_AGREE


def _compare(first: Verdict, ratios: Sequence[tuple[float, float, float]]) -> list[RatioAgreement]:
    """Compare each damping ratio of a verdict with the ratio from another computation, at the same amplitude.

    `ratios` contains (value, low, high), with the ends of the 95 % interval, in the order of the verdict's amplitudes.
    If it is shorter, the last amplitudes are not compared.
    """
    comparisons = []
    for r, (value, low, high) in zip(first.damping_ratio, ratios, strict=False):
        width = max(r.high - r.low, 1e-300)
        moved = abs(value - r.value) * 2 * NORMAL_95 / width
        comparisons.append(RatioAgreement(r.amplitude, moved, (high - low) / width))
    return comparisons


def worst_agreement(first: Verdict, ratios: Sequence[tuple[float, float, float]]) -> RatioAgreement:
    """Compare the damping ratios at all amplitudes, and return the comparison that agrees worst.

    It is the comparison with the largest value of max(moved / `AGREEMENT_SDS`, |ln wider| / ln `WIDTHS_AGREE`), see
    `RatioAgreement`.

    Parameters
    ----------
    first
        The verdict that is checked.
    ratios
        The other damping ratios: the value and both ends of its 95 % interval (dimensionless), in the order of the
        verdict's amplitudes. If there are fewer ratios than amplitudes, the last amplitudes are not compared.

    Raises
    ------
    ValueError
        If there is no ratio to compare.
    """
    return max(
        _compare(first, ratios),
        key=lambda i: max(i.moved / AGREEMENT_SDS, abs(np.log(max(i.wider, 1e-300))) / np.log(WIDTHS_AGREE)),
    )


def agreement(first: Verdict, second: Verdict) -> Agreement:
    """Compare a second verdict on a record with the first: the damping that they name, and their damping ratios.

    The result is an `Agreement`. The order of the terms in a damping sum does not matter. The damping ratios of both
    verdicts must be at the same amplitudes, in the same order.
    """
    dampings = {frozenset(v.damping.split("+")) if v.decided else frozenset() for v in (first, second)}
    comparisons = _compare(first, [(r.value, r.low, r.high) for r in second.damping_ratio])
    return Agreement(len(dampings) == 1, max((i.moved for i in comparisons), default=0.0))
