"""A verdict, and what its picture is drawn from, in the unit that a record came in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bayesdamp.units import Unit
from bayesdamp.verdict.parts import AtAmplitude, IntervalAt, Mode
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence

LENGTHS = ("record", "fit", "residual", "amplitude", "free/amplitude")
"""Arrays of a picture that are in the unit of the displacement, or of the recorded quantity."""
ENERGIES = ("work/", "free/lost")
"""Begin the names of those that are in its square per s²."""


def in_unit(v: Verdict, unit: Unit) -> Verdict:
    """The verdict with its amplitudes, and its sentence, in a record's own unit of displacement; coefficients stay in
    those of the equation of motion."""
    own, amplitudes = unit.displacement, (*v.damping_ratio, *v.modes)
    if not amplitudes or own.base == own.name or any(r.unit != own.base for r in amplitudes):
        return v

    def shown(value: object) -> object:
        if isinstance(value, tuple):
            return tuple(map(shown, value))
        if isinstance(value, Mode):
            return replace(value, first=value.first * own.scale, last=value.last * own.scale, unit=own.name)
        if isinstance(value, AtAmplitude | IntervalAt):
            return replace(value, amplitude=value.amplitude * own.scale, unit=own.name)
        return value

    names = ("damping_ratio", "next_record", "modes", "frequency_at", "over_law")
    changed = replace(v, **{name: shown(getattr(v, name)) for name in names})
    return replace(changed, sentence=sentence(changed))


def picture_in_unit(arrays: Mapping[str, np.ndarray], unit: Unit) -> dict[str, np.ndarray]:
    """What a picture is drawn from, as `inference.deviation.picture` leaves it, with lengths and energies in a record's
    own unit of displacement."""
    scale = unit.displacement.scale

    def factor(name: str) -> float:
        if name in LENGTHS:
            return scale
        return scale**2 if name.startswith(ENERGIES) else 1.0

    return {name: values if factor(name) == 1.0 else values * factor(name) for name, values in arrays.items()}
