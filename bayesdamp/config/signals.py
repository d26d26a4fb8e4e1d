"""The [[signal]] tables of a study: where each record comes from, what is known of its system, and their sweeps."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

from bayesdamp.config.checks import (
    StudyError,
    check_distinct,
    check_keys,
    check_number,
    check_plugins,
    check_table,
    join_keys,
    read_prior,
    read_section,
    show,
)
from bayesdamp.config.study import (
    UNIT,
    FileTable,
    Recording,
    SignalSpec,
    SignalTable,
    SimulateTable,
    Simulation,
    SweepTable,
)
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
FEWEST, CYCLES = 0.01, 1e6
"""The fewest and the most cycles of a simulated record (conventional)."""
MOST = 100_000
"""Signals that the sweeps of a study may make (conventional)."""
_MINIMUM = {"epsilon": 0.0, "noise_sd": 0.0}
_POSITIVE = ("noise_time", "noise_dof", *REFERENCE)
_MOTIONS = (
    "simulate", "system", "restoring", "estimate", "clock", "run", "channel", "time_unit", "least_noise",
)  # fmt: skip
_SIMULATED = ("name", "simulate", "system", "compare", "restoring", "estimate", "specimen")
_INNER_TABLES = ("simulate", "system")
_FILE_KEYS = tuple(n for n in SignalTable.model_fields if n not in ("name", *_INNER_TABLES))


def _find_law(name: object, key: str) -> RestoringLaw:
    if not isinstance(name, str):
        raise StudyError(key, f"is {show(name)}; it must be a restoring law: {', '.join(LAWS.names())}")
    check_plugins(LAWS, [name], key)
    return LAWS.get(name)


def check_laws(names: tuple[str, ...], key: str) -> tuple[str, ...]:
    """Return restoring laws' names, each once. Raises StudyError."""
    for name in names:
        _find_law(name, key)
    check_distinct(names, key, "the law")
    return names


def check_base(raw: object, laws: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the study's [system], checked against its restoring law and `laws`; against all laws if it names none."""
    base = check_table(raw, "system")
    names = [base["restoring"], *laws] if "restoring" in base else LAWS.present()
    parameters = {p for name in names for p in _find_law(name, "system.restoring").parameters}
    check_keys(base, _system_keys(sorted(parameters)), "system")
    for name, value in base.items():
        if name != "restoring":
            _read_value(name, value, join_keys("system", name))
    return base


def _system_keys(parameters: tuple[str, ...] | list[str]) -> list[str]:
    return ["restoring", *parameters, *START, "epsilon", *NOISE, *REFERENCE]


def _read_value(name: str, raw: object, key: str) -> object:
    """Read a number, "free" or a prior table. Raises StudyError."""
    if name not in REFERENCE:
        if raw == "free":
            return None
        if isinstance(raw, dict):
            return read_prior(raw, key, negative=name not in ("epsilon", *NOISE))
        if isinstance(raw, str):
            raise StudyError(key, f'is {show(raw)}; it must be a number (known), "free" or a prior table')
    return _read_number(name, raw, key)


def _read_number(name: str, raw: object, key: str) -> float:
    return check_number(raw, key, positive=name in _POSITIVE, minimum=_MINIMUM.get(name))


def _read_systems(
    base: Mapping[str, Any], own: Mapping[str, Any], laws: tuple[str, ...], key: str
) -> tuple[list[System], dict[str, float]]:
    """Return the signal's system under its own restoring law and then under the others, and its reference numbers.

    The signal's own keys replace those of the study.
    """
    first = own.get("restoring", base.get("restoring", *laws[:1]))
    if first is None:
        raise StudyError("system.restoring", f"is missing; it must be one of {', '.join(LAWS.names())}")
    every = [_find_law(first, join_keys(key, "system.restoring"))]
    every += [_find_law(name, join_keys(key, "restoring")) for name in laws if name != first]
    section = join_keys(key, "system")
    check_keys(own, _system_keys([p for law in every for p in law.parameters]), section)
    given = {name: raw for name, raw in {**base, **own}.items() if name != "restoring"}
    values: dict[str, Any] = {n: _read_value(n, raw, join_keys(section, n)) for n, raw in given.items()}
    reference = {name: float(values.pop(name)) for name in REFERENCE if name in values}
    scales = reference.get("amplitude"), reference.get("frequency")
    systems = []
    for law in every:
        inferred = (*law.parameters, *START, "noise_sd")
        further = (name for name in values if name in _system_keys(law.parameters))
        ordered = {name: values.get(name) for name in (*inferred, *further)}
        known = {name: value for name, value in ordered.items() if isinstance(value, float)}
        free = {name: value for name, value in ordered.items() if name not in known}
        systems.append(System(law.name, known, free, *scales))
    return systems, reference


def _read_simulation(raw: object, system: System, key: str) -> Simulation:
    law = LAWS.get(system.restoring)
    given = check_table(raw, key)
    own = {n for t in damping_order() if t in given for n in TERMS.get(t).further}
    numbers = (*law.parameters, *START, "epsilon", *NOISE, *sorted(own - {"rest"}))
    options = SimulateTable.model_fields
    named = term_keys(law.parameters)
    check_keys(given, [*named, *numbers, *options], key)
    settings = read_section(SimulateTable, {n: v for n, v in given.items() if n in options}, key)

    _check_translation(settings.unit, system.restoring, join_keys(key, "unit"))
    if settings.outliers > settings.samples:
        right = f"it must be at most samples ({settings.samples}), or their share below 1"
        raise StudyError(join_keys(key, "outliers"), f"is {settings.outliers:g}; {right}")

    terms = {name: term for name, term in named.items() if name in given}
    if not terms:
        right = f"give at least one of {', '.join(named)} with its coefficient (0 for none)"
        raise StudyError(key, f"names no damping; {right}")
    truth = {
        TERMS.get(t).parameter: check_number(given[name], join_keys(key, name), minimum=0.0)
        for name, t in terms.items()
    }
    truth |= {n: system.known[n] for n in numbers if n in system.known}
    truth |= {n: _read_number(n, given[n], join_keys(key, n)) for n in numbers if n in given}

    check_plugins(NOISES, [settings.noise], join_keys(key, "noise"))
    noise = NOISES.get(settings.noise)
    if noise.constants:
        what = f"is {settings.noise}, which follows from a record and cannot be simulated"
        right = 'give noise = "gaussian" and quantum, the recording step'
        raise StudyError(join_keys(key, "noise"), f"{what}; {right}")
    oscillator = Oscillator(tuple(terms.values()), system.restoring)
    needed = dict.fromkeys((*oscillator.parameters, "noise_sd", *noise.parameters))
    missing = [name for name in needed if name not in truth]
    if missing:
        what = f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
        raise StudyError(key, f"{what}; a simulation needs the true value, here or as a number in [system]")
    # A motion must oscillate, and not so often that no computation ends.
    large = next((n for n, value in truth.items() if abs(value) > LARGEST), None)
    if large is not None:
        raise StudyError(join_keys(key, large), f"is {truth[large]:g}; it must be at most {LARGEST:g}")
    length, duration = join_keys(key, "duration"), settings.duration
    try:
        cycles = oscillator.rough_frequency(truth, near=truth["theta0"]) * duration / (2 * math.pi)
    except ValueError as error:
        raise StudyError(key, f"{error}; choose parameters that let it oscillate") from None
    if not cycles >= FEWEST:
        what = f"is {duration:g} s, {cycles:.2g} of a cycle; it must be at least {FEWEST:g}"
        raise StudyError(length, f"{what}: choose parameters that let it oscillate, or a longer one")
    if cycles > CYCLES:
        what = f"is {duration:g} s, in which it swings {cycles:.3g} times"
        raise StudyError(length, f"{what}; it must be at most {CYCLES:g} cycles")
    return Simulation(damping=tuple(terms.values()), truth=truth, **settings.model_dump())


def term_keys(law: tuple[str, ...]) -> dict[str, str]:
    """Return the damping terms by the names of their coefficients in a simulation, which are the terms' own.

    A term that is also a parameter of the restoring law goes by its coefficient's name (`mu_3` for cubic damping with a
    cubic spring).

    Parameters
    ----------
    law
        Parameters of the restoring law.
    """
    return {TERMS.get(t).parameter if t in law else t: t for t in damping_order()}


def damping_order() -> list[str]:
    """Return the damping terms in the order of the names of sums: the paper's three first."""
    return [*PAPER_TERMS, *(name for name in TERMS.names() if name not in PAPER_TERMS)]


def _read_recording(entry: SignalTable, folder: Path, key: str) -> Recording:
    assert entry.file is not None
    path = folder / at_home(Path(entry.file))
    if not path.is_file():
        what = f"{entry.file!r} is not there; paths start at the study's folder {folder}"
        raise StudyError(join_keys(key, "file"), what)
    if entry.time is not None and entry.rate is not None:
        raise StudyError(join_keys(key, "rate"), "is given together with time; give one of the two")
    if isinstance(entry.start, float) and isinstance(entry.stop, float) and entry.start >= entry.stop:
        what = f"is {entry.stop:g}; it must be later than start ({entry.start:g})"
        raise StudyError(join_keys(key, "stop"), what)
    options = entry.model_dump(include=set(FileTable.model_fields))
    return Recording(file=entry.file, path=path.resolve(), **options)


def _check_translation(unit: str, restoring: str, key: str) -> None:
    if UNITS[unit].translates and not LAWS.get(restoring).translates:
        laws = ", ".join(name for name in LAWS.present() if LAWS.get(name).translates)
        what = f"is {unit!r}, a translation, which {restoring} is not"
        raise StudyError(key, f"{what}; restoring can be {laws}")


def resolve_signal(
    raw: object, base: Mapping[str, Any], folder: Path, key: str, laws: tuple[str, ...] = ()
) -> SignalSpec:
    """Return a [[signal]] table, with the study's [system], as one record to simulate or to read.

    Parameters
    ----------
    raw
        The table.
    base
        The study's [system].
    folder
        The study's, where paths start.
    key
        The table's, for messages.
    laws
        The restoring laws that the study compares, where it names some.

    Raises
    ------
    StudyError
    """
    given = check_table(raw, key)
    entry = read_section(SignalTable, given, key)
    if (entry.simulate is None) == (entry.file is None):
        both = "both simulate and file" if entry.file else "neither simulate nor file"
        raise StudyError(key, f"has {both}; it must have one of the two")
    if entry.restoring is not None:
        laws = check_laws(entry.restoring, join_keys(key, "restoring"))
    if entry.quantity == "envelope":
        return _read_envelope(entry, given, folder, key)
    if entry.unit not in UNITS:
        raise StudyError(join_keys(key, "unit"), f"is {show(entry.unit)}; it must be {UNIT}")
    if entry.frequency is not None:
        right = 'give quantity = "envelope", or remove it'
        raise StudyError(join_keys(key, "frequency"), f"is for an envelope; {right}")
    (system, *others), reference = _read_systems(base, entry.system, laws, key)
    if entry.simulate is None:
        source: Simulation | Recording = _read_recording(entry, folder, key)
        unit_key = join_keys(key, "unit")
    else:
        stray = [n for n in given if n not in _SIMULATED]
        if stray:
            is_inside = stray[0] in SimulateTable.model_fields
            right = "put it inside simulate = { ... }" if is_inside else "remove it here"
            raise StudyError(join_keys(key, stray[0]), f"belongs to a file; {right}")
        source = _read_simulation(entry.simulate, system, join_keys(key, "simulate"))
        unit_key = join_keys(key, "simulate.unit")
    for name in (system.restoring, *laws):
        _check_translation(source.unit, name, unit_key)
    unit, inertia = UNITS[source.unit], reference.get("inertia")
    if unit.quantity not in (None, source.quantity):
        right = f'it goes with quantity = "{unit.quantity}"'
        raise StudyError(unit_key, f"is {unit.name!r} with quantity {source.quantity!r}; {right}")
    if inertia is not None and not unit.physical:
        what = f"is {unit.name!r}, which has no forces; leave inertia out or use rad or m"
        raise StudyError(unit_key, what)
    own = {
        name: None if models is None else canonical_models(models, join_keys(key, name))
        for name, models in (("compare", entry.compare), ("estimate", entry.estimate))
    }
    return SignalSpec(
        entry.name,
        system,
        source,
        inertia,
        **own,
        laws=laws,
        alternatives=tuple(s for s in others if s.restoring in laws),
        specimen=entry.specimen or "",
    )


def _read_envelope(entry: SignalTable, given: Mapping[str, Any], folder: Path, key: str) -> SignalSpec:
    """Read an envelope, which has no restoring law: only its damping is weighed. Raises StudyError."""
    fields = SignalTable.model_fields
    stray = next((n for n in given if n in _MOTIONS and given[n] != fields[n].default), None)
    if stray is not None:
        raise StudyError(join_keys(key, stray), "does not apply to an envelope; remove it")
    if entry.file is None:
        raise StudyError(join_keys(key, "file"), "is missing; an envelope is read from a file")
    source = _read_recording(entry, folder, key)
    source = source if "unit" in given else source.model_copy(update={"unit": ""})
    compare = None if entry.compare is None else canonical_models(entry.compare, join_keys(key, "compare"))
    return SignalSpec(entry.name, System(""), source, compare=compare, specimen=entry.specimen or "")


def canonical_model(name: object, key: str) -> str:
    """Return a damping model with its terms in the order that all tables use. Raises StudyError."""
    valid = damping_order()
    parts = [part.strip() for part in name.split("+")] if isinstance(name, str) else []
    for part in parts:
        if part and part not in valid:
            raise StudyError(key, f"unknown damping term {part!r}{nearest(part, valid)}")
    if not parts or not all(parts) or len(set(parts)) != len(parts):
        right = "it must be a sum of different terms, such as viscous+coulomb"
        raise StudyError(key, f"is {show(name)}; {right}")
    return "+".join(term for term in valid if term in parts)


def canonical_models(names: tuple[str, ...], key: str) -> tuple[str, ...]:
    """Return damping models, each once. Raises StudyError."""
    models = tuple(canonical_model(name, key) for name in names)
    check_distinct(models, key, "the model")
    return models


def expand(signals: list[dict[str, Any]], sweeps: list[Any]) -> list[dict[str, Any]]:
    """Return the raw [[signal]] tables, repeated over every combination of the sweeps' values.

    A signal's name gets `-key-value` of each sweep that applies to it (`0.003` reads `0p003`): `simulate.*` applies to
    simulated signals, a file's key to those that are read, `system.*` to all. Raises StudyError.
    """
    tables = [read_section(SweepTable, raw, f"sweep[{i}]") for i, raw in enumerate(sweeps, start=1)]
    for i, sweep in enumerate(tables, start=1):
        key, values_key = f"sweep[{i}].key", f"sweep[{i}].values"
        head, _, tail = sweep.key.partition(".")
        valid = (
            (bool(tail) and "." not in tail) if head in _INNER_TABLES else (head in _FILE_KEYS and not tail)
        )
        if not valid:
            right = 'it must be like "simulate.noise_sd", "system.gravity" or "start"'
            raise StudyError(key, f"is {show(sweep.key)}, which is not a key of a signal; {right}")
        if not any(_applies(sweep.key, signal) for signal in signals):
            raise StudyError(key, f"is {show(sweep.key)}, which no signal has; sweep a key that one has")
        names = [suffix(sweep.key, value, sweep.values) for value in sweep.values]
        if len(set(names)) != len(names):
            what = f"holds a value twice: {show(list(sweep.values))}; once is enough"
            raise StudyError(values_key, what)
    applied = [[sweep for sweep in tables if _applies(sweep.key, signal)] for signal in signals]
    count = sum(math.prod(len(sweep.values) for sweep in own) for own in applied)
    if count > MOST:
        right = f"it must be at most {MOST}: sweep fewer values"
        raise StudyError("sweep", f"makes {count} signals of these; {right}")
    expanded = []
    for signal, own in zip(signals, applied, strict=True):
        for values in product(*(sweep.values for sweep in own)):
            table = copy.deepcopy(signal)
            for sweep, value in zip(own, values, strict=True):
                head, _, tail = sweep.key.partition(".")
                if not tail:
                    table[head] = value
                elif isinstance(inner := table.setdefault(head, {}), dict):
                    inner[tail] = value
                if isinstance(table.get("name"), str):
                    table["name"] += suffix(sweep.key, value, sweep.values)
            expanded.append(table)
    return expanded


def _applies(key: str, signal: dict[str, Any]) -> bool:
    """Return whether a sweep's key applies to a signal."""
    head = key.partition(".")[0]
    return head == "system" or (head in signal if head == "simulate" else "file" in signal)


def suffix(key: str, value: object, values: tuple[Any, ...]) -> str:
    """Return `-noise_sd-0p003` for simulate.noise_sd = 0.003; a table or a list goes by its place in the values."""
    if isinstance(value, dict | list):
        text = str(values.index(value) + 1)
    elif isinstance(value, float):
        text = repr(value).removesuffix(".0")
    else:
        text = str(value)
    text = re.sub(r"[^A-Za-z0-9_-]", "_", text.replace("-", "m", text.startswith("-")).replace(".", "p"))
    return f"-{key.rpartition('.')[2]}-{text}"
