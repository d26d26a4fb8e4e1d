"""One verdict on a specimen from the answers on its records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from bayesdamp.formatting import rounded, with_interval
from bayesdamp.inference.deviation.findings import SENSOR
from bayesdamp.inference.deviation.specimen import WeighedRun, WeighedSpecimen, weigh_specimen
from bayesdamp.priors import Prior
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.decide import rivals_of
from bayesdamp.verdict.parts import DampingRatio, Grade, Interval, Share
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import named, sentence

GRID = 400
"""Values of the spread between records over which is summed."""
WIDE = 2.0
"""Scale of the spread's half-Cauchy prior, in sds of the values' scatter (weakly informative; Gelman 2006)."""


@dataclass(frozen=True)
class Pooled:
    """Mean over records and its sd; spread between records (an sd) with its 95 % interval; 95 % interval of what one
    more record would give."""

    mean: float
    sd: float
    spread: float
    spread_low: float
    spread_high: float
    low: float
    high: float


def pooled(values: np.ndarray, sds: np.ndarray) -> Pooled:
    """Random effects: values (n,) with sds (n,) of records that differ by a normal with an unknown spread.

    The spread is summed over a grid under a half-Cauchy prior, the mean under a flat one. Of one value the spread is 0.
    """
    values, sds = np.asarray(values, float), np.maximum(np.asarray(sds, float), 1e-12 * np.abs(values).max())
    if values.size == 1:
        v, s = float(values[0]), float(sds[0])
        return Pooled(v, s, 0.0, 0.0, 0.0, v - 1.96 * s, v + 1.96 * s)
    scale = WIDE * max(float(np.std(values)), float(np.median(sds)))
    spreads = np.concatenate([[0.0], np.geomspace(1e-3, 20.0, GRID - 1) * scale])
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
    width = np.sqrt(1 / total + spreads**2 + np.median(sds) ** 2)
    low, high = (_quantile(q, means, width, weight) for q in (0.025, 0.975))
    return Pooled(mean, sd, spread, below, above, low, high)


def _quantile(q: float, means: np.ndarray, sds: np.ndarray, weight: np.ndarray) -> float:
    """Of a mixture of normals, by bisection."""
    low, high = float(np.min(means - 9 * sds)), float(np.max(means + 9 * sds))
    for _ in range(80):
        middle = 0.5 * (low + high)
        below = float(weight @ ndtr((middle - means) / sds))
        low, high = (middle, high) if below < q else (low, middle)
    return 0.5 * (low + high)


DRAWS = 20_000
"""Of a damping ratio: an end of a 95 % interval is good to 2 % of its width."""
Curve = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Answered:
    """What was said of one record: its verdict; what it weighed; its damping ratio against amplitude, with arrays
    `amplitude`, `ratio`, `low`, `high`, and, where laws may hold approximately, `over` and `over_sd`: the logarithm of
    the damping over its law's own, mean and sd."""

    verdict: Verdict
    weighed: WeighedRun
    curve: Curve


def specimen(
    name: str,
    records: Sequence[Answered],
    priors: Mapping[str, Prior] | None = None,
    sensor: float = SENSOR,
    seed: int = 0,
) -> Verdict:
    """The verdict on a specimen: one damping for all records, times a factor for each whose spread is inferred.

    Parameters
    ----------
    name
        Of the specimen.
    records
        Answers on its records.
    priors
        That are stated, by parameter.
    sensor
        Relative linearity of the sensor, the same in all records: no ratio is known better.

    Raises
    ------
    ValueError
        Where there is no record.
    """
    if not records:
        raise ValueError("a specimen needs a record with a verdict")
    weighed = weigh_specimen([r.weighed for r in records], priors, seed=seed)
    return verdict_on(name, records, weighed, sensor, seed)


def verdict_on(
    name: str, records: Sequence[Answered], weighed: WeighedSpecimen, sensor: float = SENSOR, seed: int = 0
) -> Verdict:
    """Return the verdict on a specimen that was weighed. Arguments as of `specimen`."""
    damping, restoring, others = probabilities(weighed)
    own = [r.verdict for r in records]
    ratios, following = _ratios(records, weighed, sensor if _approximate(records) else 0.0, seed)
    verdict = replace(
        together(name, own, damping, others),
        restoring=next(iter(restoring)),
        restoring_probability=min(next(iter(restoring.values())), thresholds.CAP),
        frequency=_pooled_interval([v.frequency for v in own]),
        damping_ratio=ratios,
        next_record=following,
        spread=spread_of(weighed) if len(records) > 1 else None,
    )
    r = following[len(following) // 2]
    ratio = with_interval(r.value, r.low, r.high, " %", 100)
    more = f"At the middle amplitude one more record would have a damping ratio of {ratio}."
    return replace(verdict, remarks=(*of_spread(verdict), more, *verdict.remarks), sentence=sentence(verdict))


def together(
    name: str, own: Sequence[Verdict], damping: Mapping[str, float], others: Mapping[str, float]
) -> Verdict:
    """Return what is said of several records alike, whether they are motions or envelopes.

    Parameters
    ----------
    name
        Of the specimen.
    own
        The verdicts on its records.
    damping
        Probability of each sum for all records, the likeliest first.
    others
        Probability of each form of damping that is not compared.
    """
    first, probability = next(iter(damping.items()))
    every = {**damping, **others}
    grade = max((v.grade for v in own), key=list(Grade).index)
    rivals = rivals_of(damping, others)
    return Verdict(
        record=name,
        grade=grade,
        decided=probability >= thresholds.DECIDED and grade is not Grade.DEVIATES,
        damping=first,
        probability=min(probability, thresholds.CAP),
        rivals=tuple(replace(r, probability=min(r.probability, thresholds.CAP)) for r in rivals),
        energy=_energy(own, damping),
        deviation=_largest([v.deviation for v in own]),
        unnamed=_largest([v.unnamed for v in own]),
        unexplained_pct=max(v.unexplained_pct for v in own),
        noise_pct=float(np.median([v.noise_pct for v in own])),
        remarks=_alone(own, max(every, key=every.__getitem__)),
        records=len(own),
        quantity=own[0].quantity,
    )


def _approximate(records: Sequence[Answered]) -> bool:
    return all("over" in r.curve for r in records)


def probabilities(
    weighed: WeighedSpecimen,
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Return the probability of each sum, of each law and of each other form of damping, the same for all records."""
    places = {one.damping for r in weighed.records for one in r.others}
    by_damping: dict[str, float] = {}
    by_law: dict[str, float] = {}
    for (damping, law), p in weighed.probability.items():
        by_damping[damping] = by_damping.get(damping, 0.0) + p
        by_law[law] = by_law.get(law, 0.0) + p
    ordered = [dict(sorted(one.items(), key=lambda item: -item[1])) for one in (by_damping, by_law)]
    sums, others = (
        {n: p for n, p in ordered[0].items() if (n in places) is other} for other in (False, True)
    )
    return sums, ordered[1], others


def spread_of(weighed: WeighedSpecimen) -> Interval:
    """Return the relative spread between records (standard deviation)."""
    found = weighed.spread()
    return Interval(found["median"], found["q2.5"], found["q97.5"])


def _common(records: Sequence[Answered]) -> np.ndarray:
    """Three amplitudes that all records have; those of the first record where they have none in common."""
    high = min(float(r.curve["amplitude"].max()) for r in records)
    low = max(float(r.curve["amplitude"].min()) for r in records)
    if not low < high:
        a = records[0].curve["amplitude"]
        high, low = float(a.max()), float(a.min())
    span = np.log(high / low)
    return high * np.exp(-span * np.array([0.1, 0.5, 0.9]))


def _ratios(
    records: Sequence[Answered], weighed: WeighedSpecimen, sensor: float, seed: int
) -> tuple[tuple[DampingRatio, ...], tuple[DampingRatio, ...]]:
    """The specimen's damping ratio at three amplitudes, and what one more record would have there.

    The law's own ratio is drawn from the joint posterior; by how much the damping at an amplitude is off its law is
    pooled over the records.
    """
    unit = next((v.damping_ratio[0].unit for v in (r.verdict for r in records) if v.damping_ratio), "rad")
    found, following = [], []
    for row, amplitude in enumerate(_common(records)):
        rng = np.random.default_rng([seed, row])
        law, spreads = weighed.ratios(float(amplitude), DRAWS, seed)
        own = law.copy()
        scatter = np.zeros(DRAWS)
        if _approximate(records):
            p = pooled(*np.array([_over_at(r.curve, float(amplitude)) for r in records]).T)
            own = own * np.exp(p.mean + p.sd * rng.standard_normal(DRAWS))
            scatter = np.full(DRAWS, p.spread)
        own = own * (1 + sensor * rng.standard_normal(DRAWS))
        more = own * np.exp(np.hypot(spreads, scatter) * rng.standard_normal(DRAWS))
        noise = float(np.std(law))
        for draws, rows in ((own, found), (more, following)):
            value, low, high = (float(q) for q in np.quantile(draws, (0.5, 0.025, 0.975)))
            rest = float(np.sqrt(max(float(np.std(draws)) ** 2 - noise**2, 0.0)))
            rows.append(DampingRatio(float(amplitude), unit, value, noise, rest, low, high))
    return tuple(found), tuple(following)


def _over_at(curve: Curve, amplitude: float) -> tuple[float, float]:
    """Mean and sd of the logarithm of the damping over its law's own at an amplitude, by interpolation."""
    order = np.argsort(curve["amplitude"])
    x, at = np.log(curve["amplitude"][order]), np.log(amplitude)
    return float(np.interp(at, x, curve["over"][order])), float(np.interp(at, x, curve["over_sd"][order]))


def of_spread(v: Verdict) -> tuple[str, ...]:
    """Say how much records differ."""
    if v.spread is None:
        return ()
    value, low, high = (rounded(100 * x) for x in (v.spread.value, v.spread.low, v.spread.high))
    return (
        f"The damping differs between records by {value} % (standard deviation; 95 %: {low} to {high} %).",
    )


def _pooled_interval(given: Sequence[Interval | None]) -> Interval | None:
    known = [i for i in given if i is not None]
    if not known:
        return None
    if all(i.low == i.high == known[0].value for i in known):
        return known[0]  # given, the same for all
    p = pooled(np.array([i.value for i in known]), np.array([(i.high - i.low) / 3.92 for i in known]))
    return Interval(p.mean, p.low, p.high, known[0].unit)


def _largest(given: Sequence[Interval | None]) -> Interval | None:
    """The interval with the largest value."""
    known = [i for i in given if i is not None]
    return max(known, key=lambda i: i.value) if known else None


def _energy(own: Sequence[Verdict], damping: Mapping[str, float]) -> tuple[Share, ...]:
    """Shares of the energy over several records, whose dampings have these probabilities."""
    terms = dict.fromkeys(s.term for v in own for s in v.energy)
    found = []
    for term in terms:
        shares = [s for v in own for s in v.energy if s.term == term]
        sure = sum(p for name, p in damping.items() if term in name.split("+"))
        middle = float(np.median([s.share for s in shares]))
        found.append(Share(term, middle, min(s.low for s in shares), max(s.high for s in shares), sure))
    return tuple(sorted(found, key=lambda s: -s.share))


def _alone(own: Sequence[Verdict], likeliest: str) -> tuple[str, ...]:
    """Say what records are by themselves where that is not what is likeliest for all."""
    alone = Counter(max(v.probabilities, key=v.probabilities.__getitem__) for v in own)
    if set(alone) == {likeliest}:
        return ()
    parts = [f"{named(damping)} {count}" for damping, count in alone.most_common()]
    return (f"Records by themselves are likeliest: {', '.join(parts)}.",)
