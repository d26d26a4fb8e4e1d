"""Several envelopes of one specimen: their likelihoods in the coordinates that they share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayesdamp.envelope.model.deviation import weights
from bayesdamp.envelope.results import EnvelopeResult
from bayesdamp.inference.deviation.gaussian.linear import DampingLikelihood
from bayesdamp.inference.deviation.gaussian.repeats import RunLikelihood, joined
from bayesdamp.odds import odds
from bayesdamp.priors import SCORE_RATIO, SHARED_SCALES, SharedHalfNormal
from bayesdamp.types import InputError


def shared_likelihoods(found: Sequence[EnvelopeResult]) -> dict[str, tuple[DampingLikelihood, ...]]:
    """Return the likelihoods of all records with a decay, by damping sum, in the coordinates that they share.

    The amplitude is the mean of the records' reference amplitudes, in its logarithm. Where a record has no frequency,
    the coordinates are rates: their unit follows from the geometric mean of the durations, as that of a single record
    follows from its own.

    Raises
    ------
    InputError
        Where the records have different units.
    """
    records = [one for one in found if one.likelihoods]
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


def joint_damping(found: Sequence[EnvelopeResult], seed: int = 0) -> JointDamping | None:
    """Weigh every sum with one set of coefficients for all records, times a factor for each.

    The deviation's size and length are common to the records. None where fewer than two records have a decay.

    Raises
    ------
    InputError
        Where the records have different units.
    """
    every = shared_likelihoods(found)
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
        repeats[name] = joined(runs, priors, weights()[2], seed=seed)
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
