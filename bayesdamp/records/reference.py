"""The amplitude and frequency that a record's priors and damping terms scale with."""

from __future__ import annotations

from bayesdamp.physics.oscillator import REACH, Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import InputError, Reference, System


def reference_of(system: System, seen: Features) -> Reference:
    """Amplitude and frequency that prior widths scale with: given, else from the system, else the record's.

    Raises InputError where what is known of the restoring law lets nothing swing about the record's midline.
    """
    amplitude, frequency = system.amplitude, system.frequency
    law, osc = LAWS.get(system.restoring), Oscillator(("viscous",), system.restoring)
    known = {n: system.known[n] for n in law.parameters if n in system.known}
    try:
        if known:
            start, reach = law.start(seen.frequency, seen.rest, known), REACH * max(1.0, seen.amplitude)
            osc.rough_frequency(start, seen.rest, reach)
        if len(known) == len(law.parameters):
            if frequency is None:
                frequency = osc.natural_frequency(system.known, seen.rest)
            if amplitude is None and "theta0" in system.known:
                amplitude = abs(system.known["theta0"] - osc.equilibrium(system.known, seen.rest)) or None
    except (ValueError, ZeroDivisionError):
        each = ", ".join(f"{name} = {value:g}" for name, value in known.items())
        raise InputError(
            f"{each}: the law {law.name} then has no stable equilibrium near the record's midline "
            f"({seen.rest:.3g}); give values with which it oscillates there, or leave them free"
        ) from None
    rounded = {"amplitude": float(f"{seen.amplitude:.1e}"), "frequency": float(f"{seen.frequency:.1e}")}
    return Reference(amplitude or rounded["amplitude"], frequency or rounded["frequency"])
