"""One verdict on a specimen from the answers on its envelopes: a common Q (or rate), and how far they scatter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.linear import DampingLikelihood
from bayesdamp.inference.deviation.gaussian.repeats import RunLikelihood, joined
from bayesdamp.inference.envelope.candidates import KNOTS
from bayesdamp.odds import odds
from bayesdamp.priors import SCORE_RATIO, SHARED_SCALES, SharedHalfNormal
from bayesdamp.types import InputError
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.decide import rivals_of
from bayesdamp.verdict.envelope.answer import Answer
from bayesdamp.verdict.parts import Estimate, Grade, Interval
from bayesdamp.verdict.pooled import pooled
from bayesdamp.verdict.specimen import energy_of_records, largest, of_spread, remarks_on_records, worst_grade
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import by_ten, sentence, with_interval


def shared_likelihoods(answers: Sequence[Answer]) -> dict[str, tuple[DampingLikelihood, ...]]:
    """Return the likelihoods of all records with a decay, by damping sum, in the coordinates that they share.

    The amplitude is the mean of the records' reference amplitudes, in its logarithm. Where a record has no frequency,
    the coordinates are rates: their unit follows from the geometric mean of the durations, as that of a single record
    follows from its own.

    Raises
    ------
    InputError
        Where the records have different units.
    """
    records = [one for one in answers if one.likelihoods]
    if not records:
        return {}
    every = [next(iter(one.likelihoods.values())) for one in records]
    units = list(dict.fromkeys(one.unit for one in every))
    if len(units) > 1:
        raise InputError(
            f"records of one specimen are in {' and '.join(units)}; record all of them in one unit to compare them"
        )
    amplitude = float(np.mean([one.reference for one in every]))
    if all(one.omega is not None for one in every):
        rates = [SCORE_RATIO * float(one.omega or 1.0) for one in every]
    else:
        middle = float(np.sqrt(SHARED_SCALES[0] * SHARED_SCALES[-1]))
        time = float(np.exp(np.mean(np.log([one.duration for one in every]))))
        rates = [SCORE_RATIO / (time * middle)] * len(every)
    names = [name for name in records[0].likelihoods if all(name in one.likelihoods for one in records)]
    return {
        name: tuple(
            DampingLikelihood(*one.likelihoods[name].in_scores(amplitude, rate))
            for one, rate in zip(records, rates, strict=True)
        )
        for name in names
    }


@dataclass(frozen=True)
class JointDamping:
    """One damping for several envelopes: probability of each sum, the largest first, and the relative spread of the
    damping between the records (median, 2.5 and 97.5 %)."""

    probabilities: Mapping[str, float]
    spread: tuple[float, float, float]


def joint_damping(answers: Sequence[Answer], seed: int = 0) -> JointDamping | None:
    """Weigh every sum with one set of coefficients for all records, times a factor for each.

    The deviation's size and length are common to the records. None where fewer than two records have a decay.

    Raises
    ------
    InputError
        Where the records have different units.
    """
    every = shared_likelihoods(answers)
    if not every or len(next(iter(every.values()))) < 2:
        return None
    logs, repeats = {}, {}
    for name, likelihoods in every.items():
        terms = name.split("+")
        priors = {t: SharedHalfNormal(1.0) for t in terms}
        runs = [
            RunLikelihood.of_scores(priors, terms, np.ones(len(terms)), likelihood)
            for likelihood in likelihoods
        ]
        repeats[name] = joined(runs, priors, grid_of(KNOTS, phases=False).log_prior, seed=seed)
        logs[name] = repeats[name].log_evidence + float(np.log(odds(terms)))
    top = max(logs.values())
    share = {name: float(np.exp(v - top)) for name, v in logs.items()}
    total = sum(share.values())
    ordered = dict(sorted(((n, v / total) for n, v in share.items()), key=lambda item: -item[1]))
    spreads = np.concatenate([one.spreads for one in repeats.values()])
    weight = np.concatenate([np.full(one.spreads.size, ordered[n]) for n, one in repeats.items()])
    order = np.argsort(spreads)
    at = np.cumsum(weight[order]) / weight.sum()
    value, low, high = (float(np.interp(q, at, spreads[order])) for q in (0.5, 0.025, 0.975))
    return JointDamping(ordered, (value, low, high))


def specimen(name: str, answers: Sequence[Answer]) -> Verdict | None:
    """Return the verdict on a specimen; None where fewer than two records have a decay.

    The logarithm of Q, or of the rate, is pooled as every number of several records is.

    Raises
    ------
    InputError
        Where the records have different units.
    """
    own = [one.verdict for one in answers if one.verdict.rate is not None]
    quality = all(v.quality_factor is not None for v in own)
    known = [one for v in own if (one := v.quality_factor if quality else v.rate) is not None]
    if len(known) < 2:
        return None
    x = np.log([one.value for one in known])
    sd = np.array([np.hypot(one.sd_noise, one.sd_law) / one.value for one in known])
    found = pooled(x, sd)
    joint = joint_damping(answers)
    spread = joint.spread if joint else (found.spread, found.spread_low, found.spread_high)
    value, unit = float(np.exp(found.mean)), known[0].unit
    alone = min(float(np.sum(sd**-2.0) ** -0.5), found.sd)
    low, high, next_low, next_high = np.exp(
        [found.mean - 1.96 * found.sd, found.mean + 1.96 * found.sd, found.low, found.high]
    ).tolist()
    between = value * float((found.sd**2 - alone**2) ** 0.5)
    common = Estimate(value, value * alone, between, low, high, unit)
    probabilities = (
        {n: min(p, thresholds.CAP) for n, p in joint.probabilities.items()} if joint else {"": float("nan")}
    )
    damping, probability = next(iter(probabilities.items()))
    grade = worst_grade(own)
    verdict = Verdict(
        record=name,
        grade=grade,
        decided=probability >= thresholds.DECIDED and grade is not Grade.DEVIATES,
        damping=damping,
        probability=probability,
        rivals=rivals_of(probabilities, {}),
        spread=Interval(spread[0], spread[1], spread[2]),
        energy=energy_of_records(own, probabilities),
        deviation=largest([v.deviation for v in own]),
        unexplained_pct=max(v.unexplained_pct for v in own),
        noise_pct=float(np.median([v.noise_pct for v in own])),
        records=x.size,
        quantity="envelope",
        rate=None if quality else common,
        quality_factor=common if quality else None,
        next_value=Interval(value, next_low, next_high, unit),
        standardised=float(np.sum(((x - np.average(x, weights=sd**-2.0)) / sd) ** 2)) / (x.size - 1),
    )
    what = "Q" if quality else "decay rate"
    more = by_ten(with_interval(value, next_low, next_high, f" {unit}" if unit else ""))
    said = (
        *of_spread(verdict),
        f"One more record would have {what} = {more}.",
        f"The standardised variance of the records' own values is {verdict.standardised:.1f}.",
        *(remarks_on_records(own, damping) if joint else ()),
    )
    verdict = replace(verdict, remarks=said)
    return replace(verdict, sentence=sentence(verdict))
