"""Units and definitions of parameters, in words that stand beside their draws."""

from __future__ import annotations

import inspect
from collections.abc import Iterable

from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.units import parameter_unit
from bayesdamp.types import Signal

_OF_THE_MOTION = {
    "theta0": "displacement at the first sample",
    "omega0": "velocity at the first sample",
    "epsilon": "velocity over which friction turns over: tanh(velocity/epsilon); 0 is the sign itself",
}


def units_of(names: Iterable[str], restoring: str, signal: Signal) -> dict[str, str]:
    """Unit of each parameter on a record."""
    return {n: parameter_unit(n, restoring, signal.unit, signal.quantity) for n in names}


def definition(name: str, oscillator: Oscillator, noise: str) -> str:
    """What a parameter is, in a line."""
    if name in _OF_THE_MOTION:
        return _OF_THE_MOTION[name]
    for term in oscillator.terms:
        if term.parameter == name:
            return f"coefficient of {term.name} damping: {_first_line(term)}"
    if name in oscillator.law.parameters:
        return f"{name} of the restoring law {oscillator.law.name}: {_first_line(oscillator.law)}"
    return f"{name} of {noise} noise: {_first_line(NOISES.get(noise))}"


def _first_line(thing: object) -> str:
    return (inspect.getdoc(type(thing)) or "").partition("\n")[0]
