"""Default priors: of parameters, the same in every damping model, so that evidence can be compared; of the models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import FURTHER_TERM, OTHERS, LogNormal, LogUniform, Normal, Prior, SharedHalfNormal
from bayesdamp.records.oscillation.features import Features
from bayesdamp.records.reference import Reference, reference_of

__all__ = [
    "EPSILON_RANGE",
    "EPSILON_SHARE",
    "FURTHER_TERM",
    "OTHERS",
    "Reference",
    "default_prior",
    "odds",
    "reference_of",
]

EPSILON_SHARE = 0.02
EPSILON_RANGE = (0.0005, 0.05)
"""ε as a share of the peak velocity: where it is not given, and the range of its prior where it is free."""


def default_prior(name: str, osc: Oscillator, noise: str, reference: Reference, features: Features) -> Prior:
    """The default prior of a parameter. Raises KeyError for a name without one.

    Angles are wide against the record's amplitude and centred on its midline; gravity may have either sign
    and be as large as the stiffness.
    """
    a, w = reference.amplitude, reference.frequency
    for term in osc.terms:
        if term.parameter == name:
            return SharedHalfNormal(per_ratio=1.0 / term.ratio_per_unit(a, w))
        for parameter in term.inferred:
            if parameter.name == name:
                return parameter.prior(a, w)
    priors: Mapping[str, Prior] = {
        "stiffness": LogNormal(median=w**2, sigma=0.5),
        "gravity": Normal(mean=0.0, sd=0.5 * w**2),
        "cubic": Normal(mean=0.0, sd=0.5 * w**2 / a**2),
        "spring_angle": Normal(mean=features.rest, sd=2 * a),
        "rest_angle": Normal(mean=features.rest, sd=2 * a),
        "theta0": Normal(mean=features.rest, sd=2 * a),
        "omega0": Normal(mean=0.0, sd=2 * a * w),
        "epsilon": LogUniform(low=EPSILON_RANGE[0] * a * w, high=EPSILON_RANGE[1] * a * w),
        **NOISES.get(noise).priors(features),
    }
    return priors[name]


def odds(damping: Sequence[str], others: int = 0) -> float:
    """Prior odds of a damping against a single term.

    Parameters
    ----------
    damping
        Its terms.
    others
        Number of the forms of damping that are not compared and of which it is one; 0 for a sum that is compared.
    """
    return FURTHER_TERM ** (len(damping) - 1) * (OTHERS / others if others else 1.0)
