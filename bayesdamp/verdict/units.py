"""Convert a verdict, and the arrays of its figures, to the unit of the record's file."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bayesdamp.types import Unit
from bayesdamp.verdict.parts import AtAmplitude, IntervalAt, Oscillation
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence

LENGTH_ARRAYS = ("record", "fit", "residual", "amplitude", "free/amplitude")
"""Names of the arrays of a figure whose unit is that of the displacement or of the recorded quantity."""
ENERGY_ARRAYS = ("work/", "free/lost")
"""Beginnings of the names of the arrays of a figure that contain energies, in the square of the displacement's unit per
s²."""


def in_unit(v: Verdict, unit: Unit) -> Verdict:
    """Return the verdict with its amplitudes, also those in its sentence, converted to the unit of the record's file.

    `unit` may also be a unit of velocity or acceleration (rpm, g); amplitudes are then in its base unit. Coefficients
    stay in the units of the equation of motion (rad or m, and s), and the texts of remarks are not changed. The verdict
    is returned unchanged if it has no amplitudes, if its amplitudes are not in the base unit, or if `unit` is the base
    unit.
    """
    own, amplitudes = unit.displacement, (*v.damping_ratio, *v.modes)
    if not amplitudes or own.base == own.name or any(r.unit != own.base for r in amplitudes):
        return v

    def convert(value: object) -> object:
        if isinstance(value, tuple):
            return tuple(map(convert, value))
        if isinstance(value, Oscillation):
            return replace(value, first=value.first * own.scale, last=value.last * own.scale, unit=own.name)
        if isinstance(value, AtAmplitude | IntervalAt):
            return replace(value, amplitude=value.amplitude * own.scale, unit=own.name)
        return value

    names = ("damping_ratio", "next_record", "modes", "frequency_at", "over_law")
    changed = replace(v, **{name: convert(getattr(v, name)) for name in names})
    return replace(changed, sentence=sentence(changed))


def picture_in_unit(arrays: Mapping[str, np.ndarray], unit: Unit) -> dict[str, np.ndarray]:
    """Return the arrays of a figure, converted from the base unit (rad or m) to the unit of the record's file.

    The arrays are those of `Answer.arrays` of an oscillation. Displacements are then in the unit of displacement of
    `unit`, recorded velocities and accelerations in this unit per s and s², and energies in its square per s². Other
    arrays, such as damping ratios, are not changed.
    """
    scale = unit.displacement.scale

    changed = dict(arrays)
    for name, values in arrays.items():
        if name in LENGTH_ARRAYS:
            changed[name] = values * scale
        elif name.startswith(ENERGY_ARRAYS):
            changed[name] = values * scale**2
    return changed
