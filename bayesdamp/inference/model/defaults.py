"""Default priors, and a target built with them.

They are the same in every damping model, so that evidence can be compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import LogNormal, LogUniform, Normal, Prior, SharedHalfNormal
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Reference, Signal, System


def build_target(
    signal: Signal,
    damping: tuple[str, ...],
    system: System,
    features: Features,
    reference: Reference,
    *,
    noise: str = "gaussian",
    term_priors: Mapping[str, Prior] | None = None,
) -> Target:
    """Build the target of one damping model on one record.

    Parameters
    ----------
    signal : Signal
        The record.
    damping : tuple of str
        Names of the damping terms.
    system : System
        What is known of the oscillator, and priors in place of the defaults.
    features : Features
        Of the record; default priors depend on them.
    reference : Reference
        Amplitude and frequency that the priors are relative to.
    noise : str
        Name of the noise model.
    term_priors : mapping of str to Prior, optional
        Priors of the damping terms' coefficients, by the terms' names, in place of the defaults.

    Raises
    ------
    ValueError
        Where a parameter has neither a value nor a prior.
    Refusal
        Where the noise model does not apply to the record.
    """
    osc, noise_model = Oscillator(damping, system.restoring), NOISES.get(noise)
    by_term = term_priors or {}
    by_parameter = {t.parameter: by_term[t.name] for t in osc.terms if t.name in by_term}
    given: dict[str, object] = {**system.free, **by_parameter}
    scales = reference.scales(features.rest)
    known = {**{n: scales[n] for n in osc.scales}, **system.known, **noise_model.read(signal)}
    if osc.switches and "epsilon" not in known and "epsilon" not in system.free:
        known["epsilon"] = reference.friction_width
    priors: dict[str, Prior] = {}
    for name in (*osc.parameters, *noise_model.parameters):
        if name not in known or name in osc.coefficients:
            priors[name] = given.get(name) or default_prior(name, osc, noise, reference, features)  # type: ignore[assignment]
    return Target(signal, osc, noise, priors, {k: v for k, v in known.items() if k not in priors})


EPSILON_RANGE = (0.0005, 0.05)
"""Range of the prior of ε where it is inferred, in shares of the peak velocity."""


def damping_priors(terms: Sequence[str], reference: Reference) -> dict[str, Prior]:
    """Return the default priors of damping terms: coefficients first, then the terms' own parameters."""
    a, w = reference.amplitude, reference.frequency
    every = [TERMS.get(name) for name in terms]
    coefficients = {t.parameter: SharedHalfNormal(per_ratio=1.0 / t.ratio_per_unit(a, w)) for t in every}
    return {**coefficients, **{p.name: p.prior(a, w) for t in every for p in t.inferred}}


def default_prior(name: str, osc: Oscillator, noise: str, reference: Reference, features: Features) -> Prior:
    """Return the default prior of a parameter. Raises KeyError for a name without one.

    Priors of angles are wide compared with the record's amplitude and centred on its midline. Gravity may have either
    sign and be as large as the stiffness.
    """
    a, w = reference.amplitude, reference.frequency
    of_damping = damping_priors([term.name for term in osc.terms], reference)
    if name in of_damping:
        return of_damping[name]
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
