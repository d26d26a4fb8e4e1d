"""One verdict on a specimen from the answers on its records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.deviation.gaussian.hyperparameters import LEAST_KNOTS, grid_of
from bayesdamp.inference.model.defaults import odds
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.decide import rivals_of
from bayesdamp.verdict.parts import DampingRatio, Grade, Interval, Share
from bayesdamp.verdict.pooled import Pooled, pooled
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import named, rounded, sentence

FAR = -60.0
"""Nats behind a record's best that stand for a candidate which was out of the question there."""
Curve = Mapping[str, np.ndarray]
Each = float | np.ndarray
"""A log evidence given each combination of the deviations' sizes, (c,); one number where there are none."""


@dataclass(frozen=True)
class OtherForm:
    """A form of damping that is not compared, weighed on one record under its likeliest restoring law: log evidence
    relative to the best sum; the sum that it comes to in a limit, if there is one."""

    damping: str
    restoring: str
    log_evidence: float
    place: str = ""


@dataclass(frozen=True)
class Answered:
    """What was said of one record: its verdict; log evidence of each (damping, restoring law), relative to the best;
    its damping ratio against amplitude, with arrays `amplitude`, `ratio`, `low`, `high`; other forms of damping; sizes:
    of each of all these the log ratio of posterior to prior of the deviations' sizes, over the grid, (c,)."""

    verdict: Verdict
    log_evidence: Mapping[tuple[str, str], float]
    curve: Curve
    others: tuple[OtherForm, ...] = ()
    sizes: Mapping[tuple[str, str], np.ndarray] = field(default_factory=dict)

    def of_sum(self, damping: str, restoring: str) -> Each:
        """Log evidence of a sum given each size of the deviations; `FAR` at least in all."""
        return self._each(max(self.log_evidence.get((damping, restoring), FAR), FAR), damping, restoring)

    def of_other(self, damping: str, restoring: str, place: str) -> Each:
        """The same of another form: under a law that it was not weighed under it is as far behind the law's best
        sum; where it was not weighed at all, that of the sum that it comes to in a limit."""
        for one in self.others:
            if one.damping == damping:
                behind = one.log_evidence - self._best(one.restoring) + self._best(restoring)
                return self._each(max(behind, FAR), damping, one.restoring)
        return self.of_sum(place, restoring) if place else FAR

    def _each(self, log_evidence: float, damping: str, restoring: str) -> Each:
        return log_evidence + self.sizes.get((damping, restoring), 0.0)

    def _best(self, restoring: str) -> float:
        return max([v for (_, law), v in self.log_evidence.items() if law == restoring], default=FAR)


def specimen(name: str, records: Sequence[Answered]) -> Verdict:
    """The verdict on a specimen: one damping for all records, whose sizes differ from record to record by a spread that
    is inferred. The interval of a ratio is what one more record would give.

    Raises ValueError where there is no record.
    """
    if not records:
        raise ValueError("a specimen needs a record with a verdict")
    damping, restoring, others = _probabilities(records)
    first, probability = next(iter(damping.items()))
    own = [r.verdict for r in records]
    worst = max(own, key=lambda v: list(Grade).index(v.grade))
    grade = worst.grade
    decided = probability >= thresholds.DECIDED and grade is not Grade.DEVIATES
    verdict = Verdict(
        record=name,
        grade=grade,
        decided=decided,
        damping=first,
        probability=min(probability, thresholds.CAP),
        rivals=tuple(
            replace(r, probability=min(r.probability, thresholds.CAP)) for r in rivals_of(damping, others)
        ),
        restoring=next(iter(restoring)),
        restoring_probability=min(next(iter(restoring.values())), thresholds.CAP),
        frequency=_pooled_interval([v.frequency for v in own]),
        exponent=_pooled_interval([v.exponent for v in own]),
        damping_ratio=_ratios(records),
        energy=_energy(own, damping | others),
        deviation=_largest([v.deviation for v in own]),
        unnamed=_largest([v.unnamed for v in own]),
        unexplained_pct=max(v.unexplained_pct for v in own),
        noise_pct=float(np.median([v.noise_pct for v in own])),
        remarks=_remarks(records, max(damping | others, key=lambda n: (damping | others)[n])),
        records=len(records),
    )
    return replace(verdict, sentence=sentence(verdict))


def _probabilities(
    records: Sequence[Answered],
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Of each sum, of each law and of each other form of damping, the same for all records."""
    names = {key for r in records for key in r.log_evidence}
    places = {one.damping: one.place for r in records for one in r.others}
    logs: dict[tuple[str, str], float] = {}
    for damping, law in names:
        total = _over_sizes([r.of_sum(damping, law) for r in records])
        logs[damping, law] = total + float(np.log(odds(damping.split("+"))))
    for law in {law for _, law in names}:
        for damping, place in places.items():
            total = _over_sizes([r.of_other(damping, law, place) for r in records])
            logs[damping, law] = total + float(np.log(odds(damping.split("+"), len(places))))
    top = max(logs.values())
    weight = {key: float(np.exp(v - top)) for key, v in logs.items()}
    total = sum(weight.values())
    by_damping: dict[str, float] = {}
    by_law: dict[str, float] = {}
    for (damping, law), w in weight.items():
        by_damping[damping] = by_damping.get(damping, 0.0) + w / total
        by_law[law] = by_law.get(law, 0.0) + w / total
    ordered = [dict(sorted(one.items(), key=lambda item: -item[1])) for one in (by_damping, by_law)]
    sums, others = (
        {n: p for n, p in ordered[0].items() if (n in places) is other} for other in (False, True)
    )
    return sums, ordered[1], others


def _over_sizes(each: Sequence[Each]) -> float:
    """Log evidence of a damping and a law on all records, whose deviations have sizes and a length in common: by how
    much a damper departs from its law is its own, not the record's. With sizes for each record anew, every further
    record would count once more against a law that the damper follows approximately.
    """
    total = np.asarray(sum(each))
    return (
        float(np.asarray(logsumexp(total + grid_of(LEAST_KNOTS).log_prior))) if total.ndim else float(total)
    )


def _common(records: Sequence[Answered]) -> np.ndarray:
    """Three amplitudes that all records have; those of the first record where they have none in common."""
    high = min(float(r.curve["amplitude"].max()) for r in records)
    low = max(float(r.curve["amplitude"].min()) for r in records)
    if not low < high:
        a = records[0].curve["amplitude"]
        high, low = float(a.max()), float(a.min())
    span = np.log(high / low)
    return high * np.exp(-span * np.array([0.1, 0.5, 0.9]))


def at_amplitude(curve: Curve, amplitude: float) -> tuple[float, float]:
    """A curve's log ratio and the sd of it at an amplitude, by interpolation in the logarithm."""
    order = np.argsort(curve["amplitude"])
    x = np.log(curve["amplitude"][order])
    value, low, high = (np.log(np.maximum(curve[n][order], 1e-300)) for n in ("ratio", "low", "high"))
    at = np.log(amplitude)
    return float(np.interp(at, x, value)), float(np.interp(at, x, (high - low) / 3.92))


def _ratios(records: Sequence[Answered]) -> tuple[DampingRatio, ...]:
    unit = next((v.damping_ratio[0].unit for v in (r.verdict for r in records) if v.damping_ratio), "rad")
    found = []
    for amplitude in _common(records):
        logs, sds = np.array([at_amplitude(r.curve, float(amplitude)) for r in records]).T
        p: Pooled = pooled(logs, sds)
        value = float(np.exp(p.mean))
        found.append(
            DampingRatio(
                float(amplitude),
                unit,
                value,
                value * p.sd,
                value * p.spread,
                float(np.exp(p.low)),
                float(np.exp(p.high)),
            )
        )
    return tuple(found)


def _pooled_interval(given: Sequence[Interval | None]) -> Interval | None:
    known = [i for i in given if i is not None]
    if not known:
        return None
    if all(i.low == i.high == known[0].value for i in known):
        return known[0]  # given, the same for all
    p = pooled(np.array([i.value for i in known]), np.array([(i.high - i.low) / 3.92 for i in known]))
    return Interval(p.mean, p.low, p.high, known[0].unit)


def _largest(given: Sequence[Interval | None]) -> Interval | None:
    known = [i for i in given if i is not None]
    return max(known, key=lambda i: i.value) if known else None


def _energy(own: Sequence[Verdict], damping: Mapping[str, float]) -> tuple[Share, ...]:
    terms = {s.term for v in own for s in v.energy}
    found = []
    for term in terms:
        shares = [s for v in own for s in v.energy if s.term == term]
        sure = sum(p for name, p in damping.items() if term in name.split("+"))
        middle = float(np.median([s.share for s in shares]))
        found.append(Share(term, middle, min(s.low for s in shares), max(s.high for s in shares), sure))
    return tuple(sorted(found, key=lambda s: -s.share))


def _remarks(records: Sequence[Answered], likeliest: str) -> tuple[str, ...]:
    """How much records differ, and what they are by themselves where that is not what is likeliest for all."""
    said = []
    if len(records) > 1:
        amplitude = float(_common(records)[1])
        p = pooled(*np.array([at_amplitude(r.curve, amplitude) for r in records]).T)
        value, low, high = (rounded(100 * x) for x in (p.spread, p.spread_low, p.spread_high))
        said.append(
            f"From record to record the damping ratio at the middle amplitude differs by {value} % (standard "
            f"deviation; 95 %: {low} to {high} %)."
        )
    alone: dict[str, list[str]] = {}
    for r in records:
        v = r.verdict
        first, _ = max(
            [(v.damping, v.probability), *((o.damping, o.probability) for o in v.rivals)], key=lambda x: x[1]
        )
        alone.setdefault(first, []).append(v.record)
    if set(alone) != {likeliest}:
        parts = [f"{named(d)} {len(names)}" for d, names in sorted(alone.items(), key=lambda i: -len(i[1]))]
        said.append(f"Records by themselves are likeliest: {', '.join(parts)}.")
    return tuple(said)
