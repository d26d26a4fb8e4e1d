"""Several envelopes of one specimen: their likelihoods in the coordinates that they share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayesdamp.envelope.results import EnvelopeResult
from bayesdamp.priors import SCORE_RATIO, SHARED_SCALES
from bayesdamp.types import InputError


@dataclass(frozen=True, eq=False)
class ScoreLikelihood:
    """Likelihood of one record as a function of the damping's scores x, (k,), all else integrated out.

    Under each combination of the deviation's size and length it is exp(log + xᵀ slope − xᵀ information x / 2): arrays
    of shape (c,), (c, k) and (c, k, k). A score is the damping ratio at the common amplitude in units of SCORE_RATIO;
    where no frequency is known, a rate in a common unit.
    """

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray


def shared_likelihoods(found: Sequence[EnvelopeResult]) -> dict[str, tuple[ScoreLikelihood, ...]]:
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
            ScoreLikelihood(*one.likelihoods[name].in_scores(amplitude, rate))
            for one, rate in zip(records, rates, strict=True)
        )
        for name in names
    }


def joint_answer(likelihoods: Mapping[str, Sequence[ScoreLikelihood]]) -> None:
    """Answer for the specimen from what `shared_likelihoods` returns: evidence of each sum, one set of coefficients.

    Each run's coefficients are the specimen's times a factor of its own; the deviation's size and length are common to
    the runs. Not available yet.
    """
    raise NotImplementedError("the joint evidence of several envelopes is not available yet")
