"""The amplitude and frequency that a record's priors and damping terms scale with."""

from __future__ import annotations

from bayesdamp.physics.oscillator import REACH, Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import InputError, Reference, System


def reference_of(system: System, features: Features) -> Reference:
    """Return the amplitude and frequency that prior widths scale with: given, else the system's, else the record's.

    Raises
    ------
    InputError
        Where no motion about the record's midline is possible with the known parameters of the restoring law.
    """
    amplitude, frequency = system.amplitude, system.frequency
    law, osc = LAWS.get(system.restoring), Oscillator(("viscous",), system.restoring)
    known = {n: system.known[n] for n in law.parameters if n in system.known}
    rest = features.rest
    try:
        if known:
            reach = REACH * max(1.0, features.amplitude)
            osc.rough_frequency(law.start(features.frequency, rest, known), rest, reach)
        if len(known) == len(law.parameters):
            if frequency is None:
                frequency = osc.natural_frequency(system.known, rest)
            if amplitude is None and "theta0" in system.known:
                amplitude = abs(system.known["theta0"] - osc.equilibrium(system.known, rest)) or None
    except (ValueError, ZeroDivisionError):
        each = ", ".join(f"{name} = {value:g}" for name, value in known.items())
        raise InputError(
            f"{each}: the law {law.name} then has no stable equilibrium near the record's midline "
            f"({rest:.3g}); give values with which it oscillates there, or leave them free"
        ) from None
    return Reference(
        amplitude or float(f"{features.amplitude:.1e}"), frequency or float(f"{features.frequency:.1e}")
    )
