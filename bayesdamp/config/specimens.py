"""Whether the signals of one specimen can be fitted jointly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bayesdamp.config.checks import StudyError
from bayesdamp.config.study import SignalSpec
from bayesdamp.units import unit_named


def check_specimens(
    specimens: Mapping[str, Sequence[SignalSpec]], dampings: Mapping[str, Sequence[str]], swept: bool
) -> None:
    """Refuse repeats in rad and in m, or under other candidates, and specimens in a sweep.

    specimens: by name; dampings: those that each signal is compared under; swept: whether the study has a sweep.
    Raises StudyError.
    """
    for name, specs in specimens.items():
        first = specs[0]
        if swept:
            raise StudyError(
                f"signal[{first.name}].specimen", "cannot stand beside a [[sweep]]; remove one of the two"
            )
        for spec in specs[1:]:
            key, repeat = f"signal[{spec.name}].specimen", f"is {name!r}, which signal {first.name} is too"
            if unit_named(spec.source.unit).base != unit_named(first.source.unit).base:
                units = f"{spec.source.unit} and {first.source.unit}"
                raise StudyError(
                    key, f"{repeat}, in {units}; repeats must all be angles, all lengths or all in one unit"
                )
            if spec.restoring != first.restoring or set(dampings[spec.name]) != set(dampings[first.name]):
                raise StudyError(
                    key, f"{repeat}, under other models; repeats must have the same compare and restoring"
                )
