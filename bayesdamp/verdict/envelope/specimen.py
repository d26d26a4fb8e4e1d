"""One verdict on a specimen from the answers on its envelopes: a common Q (or rate), and how far they scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bayesdamp.inference.curves.weighted import shares
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.linear import DampingLikelihood
from bayesdamp.inference.deviation.gaussian.repeats import RunLikelihood, joined
from bayesdamp.inference.deviation.specimen import WeighedSpecimen
from bayesdamp.inference.envelope.candidates import KNOTS
from bayesdamp.odds import odds
from bayesdamp.priors import SCORE_RATIO, SHARED_SCALES, SharedHalfNormal
from bayesdamp.types import InputError, Reference
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.envelope.answer import Answer
from bayesdamp.verdict.parts import Estimate, Interval
from bayesdamp.verdict.specimen import of_spread, pooled, probabilities, spread_of, together
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


def joint_damping(answers: Sequence[Answer], seed: int = 0) -> WeighedSpecimen | None:
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
        runs = [RunLikelihood.of_scores(priors, terms, np.ones(len(terms)), one) for one in likelihoods]
        model = name, ""
        repeats[model] = joined(runs, priors, grid_of(KNOTS, phases=False).log_prior, seed=seed)
        logs[model] = repeats[model].log_evidence + float(np.log(odds(terms)))
    share = dict(zip(logs, shares(np.array(list(logs.values()))).tolist(), strict=True))
    return WeighedSpecimen((), logs, share, repeats, {}, Reference(1.0, 1.0))


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
    value, unit = float(np.exp(found.mean)), known[0].unit
    alone = min(float(np.sum(sd**-2.0) ** -0.5), found.sd)
    low, high, next_low, next_high = np.exp(
        [found.mean - 1.96 * found.sd, found.mean + 1.96 * found.sd, found.low, found.high]
    ).tolist()
    between = value * float((found.sd**2 - alone**2) ** 0.5)
    common = Estimate(value, value * alone, between, low, high, unit)
    damping = probabilities(joint)[0] if joint else {"": float("nan")}
    verdict = replace(
        together(name, own, {n: min(p, thresholds.CAP) for n, p in damping.items()}, {}),
        spread=spread_of(joint) if joint else Interval(found.spread, found.spread_low, found.spread_high),
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
        *(verdict.remarks if joint else ()),
    )
    return replace(verdict, remarks=said, sentence=sentence(verdict))
