"""What a study says of each record: where it comes from, and what is known of its system."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bayesdamp.config.checks import (
    StudyError,
    below,
    distinct,
    known_keys,
    number,
    plugin_name,
    prior,
    section,
    shown,
    table,
)
from bayesdamp.config.sections import UNIT, FileTable, SignalTable, SimulateTable
from bayesdamp.config.study import Recording, SignalSpec, Simulation
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.plain_text import at_home
from bayesdamp.plugins import nearest
from bayesdamp.types import System
from bayesdamp.units import UNITS

START = ("theta0", "omega0")
NOISE = ("noise_sd", "noise_time", "noise_dof")
REFERENCE = ("amplitude", "frequency", "inertia")
LARGEST = 1e24
"""The largest true value that a simulation takes, in its own unit (conventional)."""
SHORTEST, LONGEST = 1e-12, 1e9
"""Lengths of a simulated record in s (conventional)."""
FEWEST, CYCLES = 0.01, 1e6
"""The fewest and the most cycles of a simulated record (conventional)."""
_MINIMUM = {"epsilon": 0.0, "noise_sd": 0.0}
_POSITIVE = ("noise_time", "noise_dof", *REFERENCE)
_MOTIONS = (
    "simulate", "system", "restoring", "estimate", "clock", "run", "channel", "time_unit", "least_noise",
)  # fmt: skip
_SIMULATED = ("name", "simulate", "system", "compare", "restoring", "estimate", "specimen")


def _law(name: object, key: str) -> RestoringLaw:
    if not isinstance(name, str):
        raise StudyError(key, f"is {shown(name)}; it must be a restoring law: {', '.join(LAWS.names())}")
    return LAWS.get(plugin_name(LAWS, name, key))


def check_base(raw: object, laws: tuple[str, ...] = ()) -> dict[str, Any]:
    """The study's [system], checked against its restoring law and those compared, or against all where it names
    none."""
    base = table(raw, "system")
    names = [base["restoring"], *laws] if "restoring" in base else LAWS.present()
    parameters = {p for name in names for p in _law(name, "system.restoring").parameters}
    known_keys(base, _system_keys(sorted(parameters)), "system")
    for name, value in base.items():
        if name != "restoring":
            _value(name, value, below("system", name))
    return base


def _system_keys(parameters: tuple[str, ...] | list[str]) -> list[str]:
    return ["restoring", *parameters, *START, "epsilon", *NOISE, *REFERENCE]


def _value(name: str, raw: object, key: str) -> object:
    """A number, "free" or a prior table. Raises StudyError."""
    if name in REFERENCE:
        return number(raw, key, positive=True)
    if raw == "free":
        return None
    if isinstance(raw, dict):
        return prior(raw, key, negative=name not in ("epsilon", *NOISE))
    if isinstance(raw, str):
        raise StudyError(key, f'is {shown(raw)}; it must be a number (known), "free" or a prior table')
    return number(raw, key, positive=name in _POSITIVE, minimum=_MINIMUM.get(name))


def _systems(
    base: Mapping[str, Any], own: Mapping[str, Any], laws: tuple[str, ...], key: str
) -> tuple[list[System], dict[str, float]]:
    """The signal's system, its own keys over the study's, under its restoring law and then under the others that
    it is compared under. Also its reference numbers."""
    first = own.get("restoring", base.get("restoring", *laws[:1]))
    if first is None:
        raise StudyError("system.restoring", f"is missing; it must be one of {', '.join(LAWS.names())}")
    every = [_law(first, below(key, "system.restoring"))]
    every += [_law(name, below(key, "restoring")) for name in laws if name != first]
    known_keys(own, _system_keys([p for law in every for p in law.parameters]), below(key, "system"))
    found = [_system(law, base, own, key) for law in every]
    return [system for system, _ in found], found[0][1]


def _system(
    law: RestoringLaw, base: Mapping[str, Any], own: Mapping[str, Any], key: str
) -> tuple[System, dict[str, float]]:
    valid = _system_keys(law.parameters)
    values = {
        name: _value(name, raw, below(where, name))
        for where, given in (("system", base), (below(key, "system"), own))
        for name, raw in given.items()
        if name in valid[1:]
    }
    reference = {name: float(values.pop(name)) for name in REFERENCE if name in values}  # type: ignore[arg-type]
    inferred = (*law.parameters, *START, "noise_sd")
    ordered = {name: values.get(name) for name in (*inferred, *values)}
    known = {name: value for name, value in ordered.items() if isinstance(value, float)}
    free = {name: value for name, value in ordered.items() if name not in known}
    system = System(law.name, known, free, reference.get("amplitude"), reference.get("frequency"))
    return system, reference


def _simulation(raw: object, system: System, key: str) -> Simulation:
    law = LAWS.get(system.restoring)
    given = table(raw, key)
    own = {n for t in damping_order() if t in given for n in TERMS.get(t).further}
    numbers = (*law.parameters, *START, "epsilon", *NOISE, *sorted(own - {"rest"}))
    options = SimulateTable.model_fields
    named = term_keys(law.parameters)
    known_keys(given, [*named, *numbers, *options], key)
    settings = section(SimulateTable, {n: v for n, v in given.items() if n in options}, key)

    _check_translation(settings.unit, system.restoring, below(key, "unit"))
    if settings.outliers > settings.samples:
        right = f"it must be at most samples ({settings.samples}), or their share below 1"
        raise StudyError(below(key, "outliers"), f"is {settings.outliers:g}; {right}")

    terms = tuple(term for name, term in named.items() if name in given)
    if not terms:
        valid = ", ".join(named)
        raise StudyError(
            key, f"names no damping; give at least one of {valid} with its coefficient (0 for none)"
        )
    truth = {
        TERMS.get(t).parameter: number(given[name], below(key, name), minimum=0.0)
        for name, t in named.items()
        if name in given
    }
    truth |= {n: system.known[n] for n in numbers if n in system.known}
    truth |= {
        n: number(given[n], below(key, n), positive=n in _POSITIVE, minimum=_MINIMUM.get(n))
        for n in numbers
        if n in given
    }

    noise = NOISES.get(plugin_name(NOISES, settings.noise, below(key, "noise")))
    if noise.constants:
        what = f"is {settings.noise}, which a record shows and nobody draws from"
        raise StudyError(
            below(key, "noise"), f'{what}; give noise = "gaussian" and quantum, the recording step'
        )
    oscillator = Oscillator(terms, system.restoring)
    needed = dict.fromkeys((*oscillator.parameters, "noise_sd", *noise.parameters))
    missing = [name for name in needed if name not in truth]
    if missing:
        what = f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
        raise StudyError(key, f"{what}; a simulation needs the true value, here or as a number in [system]")
    _check_motion(oscillator, truth, settings.duration, key)
    return Simulation(damping=terms, truth=truth, **settings.model_dump())


def _check_motion(oscillator: Oscillator, truth: Mapping[str, float], duration: float, key: str) -> None:
    """Refuse what does not oscillate, or so often that no computation ends. Raises StudyError."""
    large = next((n for n, value in truth.items() if abs(value) > LARGEST), None)
    if large is not None:
        raise StudyError(below(key, large), f"is {truth[large]:g}; it must be at most {LARGEST:g}")
    if not SHORTEST <= duration <= LONGEST:
        right = f"it must be from {SHORTEST:g} to {LONGEST:g} s"
        raise StudyError(below(key, "duration"), f"is {duration:g}; {right}")
    try:
        cycles = oscillator.rough_frequency(truth, near=truth["theta0"]) * duration / (2 * math.pi)
    except ValueError as error:
        raise StudyError(key, f"{error}; choose parameters that let it oscillate") from None
    if not cycles >= FEWEST:
        what = f"is {duration:g} s, {cycles:.2g} of a cycle; it must be at least {FEWEST:g}"
        raise StudyError(
            below(key, "duration"), f"{what}: choose parameters that let it oscillate, or a longer one"
        )
    if cycles > CYCLES:
        what = f"is {duration:g} s, in which it swings {cycles:.3g} times"
        raise StudyError(below(key, "duration"), f"{what}; it must be at most {CYCLES:g} cycles")


def term_keys(law: tuple[str, ...]) -> dict[str, str]:
    """The damping terms by the names that a simulation gives their coefficients under, the term's own; one that is a
    parameter of the restoring law too goes by its coefficient's (`mu_3` for cubic damping beside a cubic spring)."""
    return {TERMS.get(t).parameter if t in law else t: t for t in damping_order()}


def damping_order() -> list[str]:
    """The damping terms in the order in which the names of sums show them: the paper's three first."""
    return [*PAPER_TERMS, *(name for name in TERMS.names() if name not in PAPER_TERMS)]


def _recording(entry: SignalTable, folder: Path, key: str) -> Recording:
    assert entry.file is not None
    path = folder / at_home(Path(entry.file))
    if not path.is_file():
        raise StudyError(
            below(key, "file"), f"{entry.file!r} is not there; paths start at the study's folder {folder}"
        )
    if entry.time is not None and entry.rate is not None:
        raise StudyError(below(key, "rate"), "is given beside time; give one of the two")
    if isinstance(entry.start, float) and isinstance(entry.stop, float) and entry.start >= entry.stop:
        raise StudyError(
            below(key, "stop"), f"is {entry.stop:g}; it must be later than start ({entry.start:g})"
        )
    return Recording(
        file=entry.file,
        path=path.resolve(),
        **entry.model_dump(include=set(FileTable.model_fields)),
    )


def _check_translation(unit: str, restoring: str, key: str) -> None:
    if UNITS[unit].translates and not LAWS.get(restoring).translates:
        laws = ", ".join(name for name in LAWS.present() if LAWS.get(name).translates)
        what = f"is {unit!r}, a translation, which {restoring} is not"
        raise StudyError(key, f"{what}; restoring can be {laws}")


def _check_unit(source: Simulation | Recording, inertia: float | None, key: str) -> None:
    """A unit that is of another quantity, or one of a sensor where forces are asked for."""
    unit = UNITS[source.unit]
    if unit.quantity not in (None, source.quantity):
        right = f'it goes with quantity = "{unit.quantity}"'
        raise StudyError(key, f"is {unit.name!r} with quantity {source.quantity!r}; {right}")
    if inertia is not None and not unit.physical:
        raise StudyError(key, f"is {unit.name!r}, which has no forces; leave inertia out or use rad or m")


def resolve_signal(
    raw: object, base: Mapping[str, Any], folder: Path, key: str, laws: tuple[str, ...] = ()
) -> SignalSpec:
    """A [[signal]] table with the study's [system] as one record to make or to read.

    laws: the restoring laws that the study compares, where it names some. Raises StudyError.
    """
    given = table(raw, key)
    entry = section(SignalTable, given, key)
    if (entry.simulate is None) == (entry.file is None):
        both = "both simulate and file" if entry.file else "neither simulate nor file"
        raise StudyError(key, f"has {both}; it must have one of the two")
    if entry.restoring is not None:
        laws = restoring_laws(entry.restoring, below(key, "restoring"))
    if entry.quantity == "envelope":
        return _envelope(entry, given, folder, key)
    if entry.unit not in UNITS:
        raise StudyError(below(key, "unit"), f"is {shown(entry.unit)}; it must be {UNIT}")
    if entry.frequency is not None:
        raise StudyError(
            below(key, "frequency"), 'is for an envelope; give quantity = "envelope", or remove it'
        )
    (system, *others), reference = _systems(base, entry.system, laws, key)
    if entry.simulate is None:
        source: Simulation | Recording = _recording(entry, folder, key)
        unit_key = below(key, "unit")
    else:
        stray = [n for n in given if n not in _SIMULATED]
        if stray:
            is_inside = stray[0] in SimulateTable.model_fields
            right = "put it inside simulate = { ... }" if is_inside else "remove it here"
            raise StudyError(below(key, stray[0]), f"belongs to a file; {right}")
        source = _simulation(entry.simulate, system, below(key, "simulate"))
        unit_key = below(key, "simulate.unit")
    for name in (system.restoring, *laws):
        _check_translation(source.unit, name, unit_key)
    _check_unit(source, reference.get("inertia"), unit_key)
    own = {
        name: None if models is None else canonical_models(models, below(key, name))
        for name, models in (("compare", entry.compare), ("estimate", entry.estimate))
    }
    return SignalSpec(
        entry.name,
        system,
        source,
        reference.get("inertia"),
        **own,
        laws=laws,
        alternatives=tuple(s for s in others if s.restoring in laws),
        specimen=entry.specimen or "",
    )


def _envelope(entry: SignalTable, given: Mapping[str, Any], folder: Path, key: str) -> SignalSpec:
    """An envelope: only its damping is weighed, so that it has no restoring law. Raises StudyError."""
    stray = next(
        (n for n in given if n in _MOTIONS and given[n] != SignalTable.model_fields[n].default), None
    )
    if stray is not None:
        raise StudyError(below(key, stray), "does not apply to an envelope; remove it")
    if entry.file is None:
        raise StudyError(below(key, "file"), "is missing; an envelope is read from a file")
    source = _recording(entry, folder, key)
    source = source if "unit" in given else source.model_copy(update={"unit": ""})
    compare = None if entry.compare is None else canonical_models(entry.compare, below(key, "compare"))
    return SignalSpec(entry.name, System(""), source, compare=compare, specimen=entry.specimen or "")


def restoring_laws(names: tuple[str, ...], key: str) -> tuple[str, ...]:
    """Restoring laws' names, each once. Raises StudyError."""
    for name in names:
        _law(name, key)
    distinct(names, key, "the law")
    return names


def canonical_model(name: object, key: str) -> str:
    """A damping model with its terms in the one order that all tables use. Raises StudyError."""
    valid = damping_order()
    parts = [part.strip() for part in name.split("+")] if isinstance(name, str) else []
    for part in parts:
        if part and part not in valid:
            raise StudyError(key, f"unknown damping term {part!r}{nearest(part, valid)}")
    if not parts or not all(parts) or len(set(parts)) != len(parts):
        raise StudyError(
            key, f"is {shown(name)}; it must be a sum of different terms, such as viscous+coulomb"
        )
    return "+".join(term for term in valid if term in parts)


def canonical_models(names: tuple[str, ...], key: str) -> tuple[str, ...]:
    """Damping models, each once. Raises StudyError."""
    found = tuple(canonical_model(name, key) for name in names)
    distinct(found, key, "the model")
    return found
