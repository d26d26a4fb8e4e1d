"""The amplitude and frequency that a record's priors and damping terms scale with."""

from __future__ import annotations

from dataclasses import dataclass

from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import System


@dataclass(frozen=True)
class Reference:
    """Reference amplitude (rad or m) and angular frequency (rad/s) of a study: prior widths scale with it."""

    amplitude: float
    frequency: float

    def scales(self, rest: float) -> dict[str, float]:
        """What damping terms may take that is no parameter, by name; rest: where the motion rests, rad or m."""
        return {
            "rest": rest,
            "reference_velocity": self.peak_velocity,
            "reference_amplitude": self.amplitude,
        }

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
