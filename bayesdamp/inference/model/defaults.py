"""Default priors: the same in every damping model, so that evidence can be compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import HalfNormal, LogNormal, LogUniform, Normal, Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import System

RATIO_SCALE = 0.1
"""Scale of the half-normal prior on each term's equivalent damping ratio at the reference."""

EPSILON_SHARE = 0.02
EPSILON_RANGE = (0.0005, 0.05)
"""ε as a share of the peak velocity: where it is not given, and the range of its prior where it is free."""


@dataclass(frozen=True)
class Reference:
    """Reference amplitude (rad or m) and angular frequency (rad/s) of a study: prior widths scale with it."""

    amplitude: float
    frequency: float

    @property
    def peak_velocity(self) -> float:
        """Amplitude times frequency, rad/s or m/s."""
        return self.amplitude * self.frequency


def reference_of(system: System, seen: Features) -> Reference:
    """Amplitude and frequency that prior widths scale with: given, else from the system, else the record's."""
    amplitude, frequency = system.amplitude, system.frequency
    law = LAWS.get(system.restoring)
    if all(n in system.known for n in law.parameters):
        osc = Oscillator(("viscous",), system.restoring)
        if frequency is None:
            frequency = osc.natural_frequency(system.known, seen.rest)
        if amplitude is None and "theta0" in system.known:
            amplitude = abs(system.known["theta0"] - osc.equilibrium(system.known, seen.rest)) or None
    rounded = {"amplitude": float(f"{seen.amplitude:.1e}"), "frequency": float(f"{seen.frequency:.1e}")}
    return Reference(amplitude or rounded["amplitude"], frequency or rounded["frequency"])


def default_prior(name: str, osc: Oscillator, noise: str, reference: Reference, features: Features) -> Prior:
    """The default prior of a parameter. Raises KeyError for a name without one.

    Angles are wide against the record's amplitude and centred on its midline; gravity may have either sign
    and be as large as the stiffness.
    """
    a, w = reference.amplitude, reference.frequency
    for term in osc.terms:
        if term.parameter == name:
            return HalfNormal(scale=RATIO_SCALE / term.ratio_per_unit(a, w))
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
