"""Read the tables [[signal]] of a study: the source of each record, the known parameters of its system, and sweeps."""

import copy
import math
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
    as_name,
)
from bayesdamp.formatting import show
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.oscillator import Oscillator, check_restoring
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.plain_text import at_home
from bayesdamp.plugins import nearest
from bayesdamp.types import UNITS, InputError, System

START = ("theta0", "omega0")
"""Names of the initial conditions of a motion: displacement (rad or m) and velocity (rad/s or m/s) at the first sample
that is used."""
NOISE = ("noise_sd", "noise_time", "noise_dof")
"""Names of the noise parameters: standard deviation in the base unit of the recorded quantity (such as rad or rad/s),
correlation time in s, and degrees of freedom of Student's t."""
REFERENCE = ("amplitude", "frequency", "inertia")
"""Keys of [system] that are not inferred: amplitude (rad or m) and frequency (rad/s) by which priors are scaled, and
inertia (kg m² or kg), with which forces and energies get physical units."""
LARGEST_VALUE = 1e24
"""Largest absolute value that a study may give as the true value of a parameter of a simulation, in the parameter's
unit (conventional)."""
LEAST_CYCLES, MOST_CYCLES = 0.01, 1e6
"""Smallest and largest number of cycles (of small oscillations) of a simulated record; other numbers are an error of
the study (conventional)."""
MOST_SIGNALS = 100_000
"""Greatest number of signals of a study, counted after each is repeated for all values of the sweeps; more are an error
(conventional)."""
_MINIMUM = {"epsilon": 0.0, "noise_sd": 0.0}
_POSITIVE = ("noise_time", "noise_dof", *REFERENCE)
_NOT_OF_ENVELOPES = (
    "simulate", "system", "restoring", "estimate", "clock", "run", "channel", "time_unit", "least_noise",
)  # fmt: skip
_SIMULATED = ("name", "simulate", "system", "compare", "restoring", "estimate", "specimen")
_INNER_TABLES = ("simulate", "system")
_FILE_KEYS = tuple(n for n in SignalTable.model_fields if n not in ("name", *_INNER_TABLES))


def _find_law(name: object, key: str) -> RestoringLaw:
    """Return a restoring law by name. Raises StudyError, at `key`, if `name` is not that of a law."""
    if not isinstance(name, str):
        raise StudyError(key, f"is {show(name)}; give a restoring law in quotes: {', '.join(LAWS.names())}")
    check_plugins(LAWS, [name], key)
    return LAWS.get(name)


def check_laws(names: tuple[str, ...], key: str) -> tuple[str, ...]:
    """Check that the names are different restoring laws, and return them. Raises StudyError, which names `key`."""
    for name in names:
        _find_law(name, key)
    check_distinct(names, key, "the law")
    return names


def check_base(raw: object, laws: tuple[str, ...] = ()) -> dict[str, Any]:
    """Check the table [system] of a study, and return it as it is.

    If the table names a restoring law, its parameters of restoring laws must belong to this law or to `laws`, the laws
    that the study compares; otherwise to any law. Raises StudyError if the table is wrong.
    """
    base = check_table(raw, "system")
    names = [base["restoring"], *laws] if "restoring" in base else LAWS.present()
    parameters = {p for name in names for p in _find_law(name, "system.restoring").parameters}
    check_keys(base, _system_keys(sorted(parameters)), "system")
    for name, value in base.items():
        if name != "restoring":
            _read_value(name, value, join_keys("system", name))
    return base


def _system_keys(parameters: tuple[str, ...] | list[str]) -> list[str]:
    """Return the valid keys of [system]: the given parameters of restoring laws, and the keys that suit every law."""
    return ["restoring", *parameters, *START, "epsilon", *NOISE, *REFERENCE]


def _read_value(name: str, raw: object, key: str) -> object:
    """Return what a study states about the parameter `name`: a number, None for "free" (unknown), or a prior.

    raw: the value in the study file; a table describes a prior. A name in `REFERENCE` must have a positive number. key:
    full key of the parameter, for messages. Raises StudyError if the value is wrong.
    """
    if name not in REFERENCE:
        if raw == "free":
            return None
        if isinstance(raw, dict):
            return read_prior(raw, key, negative=name not in ("epsilon", *NOISE))
        if isinstance(raw, str):
            raise StudyError(key, f'is {show(raw)}; it must be a number (known), "free" or a prior table')
    return _read_number(name, raw, key)


def _read_number(name: str, raw: object, key: str) -> float:
    """Return a raw value as a number that the parameter `name` may have. Raises StudyError at `key`.

    Reference values, noise_time and noise_dof must be positive, noise_sd and epsilon not negative.
    """
    return check_number(raw, key, positive=name in _POSITIVE, minimum=_MINIMUM.get(name))


def _read_systems(
    base: Mapping[str, Any], own: Mapping[str, Any], laws: tuple[str, ...], key: str
) -> tuple[list[System], dict[str, float]]:
    """Return what the study states about the oscillator of a signal, once for each restoring law that is compared.

    Parameters
    ----------
    base, own
        The tables `system` of the study and of the signal; keys of the signal replace those of the study.
    laws
        The restoring laws that are compared.
    key
        Key of the signal in the study file, for messages.

    Returns
    -------
    systems
        First the system under the law that `own` or `base` names, or else under the first of `laws`; then one under
        each other law of `laws`. A parameter that is given as a number is known; any other has its stated prior, or
        None, which means its default prior.
    reference
        Amplitude (rad or m), frequency (rad/s) and inertia (kg m² or kg), as far as the tables state them, by name.

    Raises
    ------
    StudyError
        A law is missing or unknown, or a key or value is wrong.
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
        try:
            check_restoring(law.name, known)
        except InputError as error:
            raise StudyError(section, error.what) from None
        systems.append(System(law.name, known, free, *scales))
    return systems, reference


def _read_simulation(raw: object, system: System, key: str) -> Simulation:
    """Return the record to simulate that the table `simulate` of a signal describes.

    True values that the table does not state are the known values of `system`. `key` is the full key of the table, for
    messages. Raises StudyError if a value is missing or wrong, or if the motion would hardly oscillate or have too many
    cycles.
    """
    law = LAWS.get(system.restoring)
    given = check_table(raw, key)
    own = {n for t in damping_order() if t in given for n in TERMS.get(t).further}
    numbers = (*law.parameters, *START, "epsilon", *NOISE, *sorted(own - {"rest"}))
    options = SimulateTable.model_fields
    named = term_keys(law.parameters)
    check_keys(given, [*named, *numbers, *options], key)
    settings = read_section(SimulateTable, {n: v for n, v in given.items() if n in options}, key)

    check_translation(settings.unit, system.restoring, join_keys(key, "unit"))
    if settings.outliers > settings.samples:
        right = f"it must be at most samples ({settings.samples}), or a fraction of them below 1"
        raise StudyError(join_keys(key, "outliers"), f"is {settings.outliers:g}; {right}")

    terms = {name: term for name, term in named.items() if name in given}
    if not terms:
        right = f"give at least one of {', '.join(named)} with its coefficient (0 for none)"
        raise StudyError(key, f"has no damping term; {right}")
    truth = {
        TERMS.get(t).parameter: check_number(given[name], join_keys(key, name), minimum=0.0)
        for name, t in terms.items()
    }
    truth |= {n: system.known[n] for n in numbers if n in system.known}
    truth |= {n: _read_number(n, given[n], join_keys(key, n)) for n in numbers if n in given}

    check_plugins(NOISES, [settings.noise], join_keys(key, "noise"))
    noise = NOISES.get(settings.noise)
    if noise.constants:
        what = f"is {settings.noise}, which needs the recording step of a record and cannot be simulated"
        right = 'give noise = "gaussian" and quantum, the recording step'
        raise StudyError(join_keys(key, "noise"), f"{what}; {right}")
    oscillator = Oscillator(tuple(terms.values()), system.restoring)
    needed = dict.fromkeys((*oscillator.parameters, "noise_sd", *noise.parameters))
    missing = [name for name in needed if name not in truth]
    if missing:
        what = f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
        raise StudyError(key, f"{what}; a simulation needs the true value, here or as a number in [system]")
    # The motion must oscillate, but not so often that a simulation takes too long.
    large = next((n for n, value in truth.items() if abs(value) > LARGEST_VALUE), None)
    if large is not None:
        right = f"its absolute value must be at most {LARGEST_VALUE:g}"
        raise StudyError(join_keys(key, large), f"is {truth[large]:g}; {right}")
    length, duration = join_keys(key, "duration"), settings.duration
    try:
        cycles = oscillator.rough_frequency(truth, near=truth["theta0"]) * duration / (2 * math.pi)
    except ValueError as error:
        raise StudyError(key, f"{error} {settings.unit}; choose parameters that let it oscillate") from None
    if not cycles >= LEAST_CYCLES:
        what = f"is {duration:g} s, or {cycles:.2g} cycles; it must be at least {LEAST_CYCLES:g} cycles"
        raise StudyError(length, f"{what}: choose a longer duration, or a higher natural frequency")
    if cycles > MOST_CYCLES:
        what = f"is {duration:g} s, or {cycles:.3g} cycles"
        raise StudyError(length, f"{what}; it must be at most {MOST_CYCLES:g} cycles")
    return Simulation(damping=tuple(terms.values()), truth=truth, **settings.model_dump())


def term_keys(law: tuple[str, ...]) -> dict[str, str]:
    """Return the damping terms by their keys in the table `simulate`.

    The key is the name of the term. If the restoring law has a parameter of this name, the key is instead the name of
    the term's coefficient (`mu_3` for cubic damping with a cubic spring).

    Parameters
    ----------
    law
        Parameters of the restoring law.
    """
    return {TERMS.get(t).parameter if t in law else t: t for t in damping_order()}


def damping_order() -> list[str]:
    """Return all damping terms, shipped and from plug-ins, in the order in which they are named in damping sums.

    These are viscous, coulomb and quadratic (`PAPER_TERMS`), then the others in alphabetical order. Plug-ins of
    installed packages are included.
    """
    return [*PAPER_TERMS, *(name for name in TERMS.names() if name not in PAPER_TERMS)]


def _read_recording(entry: SignalTable, folder: Path, key: str) -> Recording:
    """Return the path and the reading options of a signal's record; the file itself is not read yet.

    entry: the table [[signal]]. folder: folder of the study. key: key of the signal, for messages. Raises StudyError if
    the file does not exist.
    """
    assert entry.file is not None
    path = folder / at_home(Path(entry.file))
    if not path.is_file():
        what = f"{entry.file!r} does not exist; paths are relative to the folder of the study, {folder}"
        raise StudyError(join_keys(key, "file"), what)
    options = entry.model_dump(include=set(FileTable.model_fields))
    return Recording(file=entry.file, path=path.resolve(), **options)


def check_translation(unit: str, restoring: str, key: str) -> None:
    """Raise StudyError at `key` if the unit is that of a translation (such as m or V), but the law needs an angle."""
    if UNITS[unit].translates and not LAWS.get(restoring).translates:
        laws = ", ".join(name for name in LAWS.present() if LAWS.get(name).translates)
        what = f"is {unit!r}, a translation, but the restoring law {restoring} needs an angle"
        raise StudyError(key, f"{what}; restoring can be {laws}")


def resolve_signal(
    raw: object, base: Mapping[str, Any], folder: Path, key: str, laws: tuple[str, ...] = ()
) -> SignalSpec:
    """Check a table [[signal]] together with [system], and return the specification of its record.

    Parameters
    ----------
    raw
        The table.
    base
        The table [system] of the study.
    folder
        Folder of the study, to which paths are relative.
    key
        Key of the table, for messages.
    laws
        The restoring laws that the study compares, if it names any; they are used for the record unless the table has
        its own `restoring`.

    Returns
    -------
    SignalSpec
        The record to simulate or to read.

    Raises
    ------
    StudyError
        The table is wrong.
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
        raise StudyError(join_keys(key, "unit"), f"unknown unit {show(entry.unit)}; it must be {UNIT}")
    if entry.frequency is not None:
        what = 'applies only to an envelope; give quantity = "envelope", or remove frequency'
        raise StudyError(join_keys(key, "frequency"), what)
    (system, *others), reference = _read_systems(base, entry.system, laws, key)
    if entry.simulate is None:
        source: Simulation | Recording = _read_recording(entry, folder, key)
        unit_key = join_keys(key, "unit")
    else:
        stray = [n for n in given if n not in _SIMULATED]
        if stray:
            is_inside = stray[0] in SimulateTable.model_fields
            right = "put it inside simulate = { ... }" if is_inside else "remove it here"
            raise StudyError(join_keys(key, stray[0]), f"is for a record from a file; {right}")
        source = _read_simulation(entry.simulate, system, join_keys(key, "simulate"))
        unit_key = join_keys(key, "simulate.unit")
    for name in (system.restoring, *laws):
        check_translation(source.unit, name, unit_key)
    unit, inertia = UNITS[source.unit], reference.get("inertia")
    if unit.quantity not in (None, source.quantity):
        right = f'this unit needs quantity = "{unit.quantity}"'
        raise StudyError(unit_key, f"is {unit.name!r} with quantity {source.quantity!r}; {right}")
    if inertia is not None and not unit.physical:
        what = f"is {unit.name!r}, a unit in which inertia has no meaning; remove inertia, or use rad or m"
        raise StudyError(unit_key, what)
    own = {
        name: None if models is None else canonical_models(models, join_keys(key, name))
        for name, models in (("compare", entry.compare), ("estimate", entry.estimate))
    }
    specimen, alternatives = entry.specimen or "", tuple(s for s in others if s.restoring in laws)
    return SignalSpec(
        entry.name, system, source, inertia, **own, laws=laws, alternatives=alternatives, specimen=specimen
    )


def _read_envelope(entry: SignalTable, given: Mapping[str, Any], folder: Path, key: str) -> SignalSpec:
    """Return the specification of a signal that is an envelope (recorded amplitudes), which has no restoring law.

    `entry` is the table [[signal]]; `given` contains only the keys that the file states. Raises StudyError if a key
    that does not apply to an envelope differs from its default, if the file is missing, or if `compare` is wrong.
    """
    fields = SignalTable.model_fields
    stray = next((n for n in given if n in _NOT_OF_ENVELOPES and given[n] != fields[n].default), None)
    if stray is not None:
        raise StudyError(join_keys(key, stray), "does not apply to an envelope; remove it")
    if entry.file is None:
        raise StudyError(join_keys(key, "file"), "is missing; an envelope is read from a file")
    source = _read_recording(entry, folder, key)
    source = source if "unit" in given else source.model_copy(update={"unit": ""})
    compare = None if entry.compare is None else canonical_models(entry.compare, join_keys(key, "compare"))
    return SignalSpec(entry.name, System(""), source, compare=compare, specimen=entry.specimen or "")


def canonical_model(name: object, key: str) -> str:
    """Return a damping sum, such as `viscous+coulomb`, with its terms in the order of `damping_order`.

    `key` is the key of the study file with the sum, for messages. Raises StudyError if `name` is not a sum of different
    damping terms.
    """
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
    """Return damping sums, such as viscous+coulomb, each with its terms in the order of `damping_order`.

    key: key of the study file with the sums, for messages. Raises StudyError if a name is not a sum of different
    damping terms, or if a sum is repeated.
    """
    models = tuple(canonical_model(name, key) for name in names)
    check_distinct(models, key, "the model")
    return models


def expand(signals: list[dict[str, Any]], sweeps: list[Any]) -> list[dict[str, Any]]:
    """Return the raw [[signal]] tables, repeated for every combination of the sweeps' values.

    A sweep over a key `simulate.*` applies to simulated signals, a sweep over `system.*` to all signals, and a sweep
    over any other key to signals that are read from files. The name of a signal gets a suffix `-key-value` for each
    sweep that applies (0.003 becomes `0p003`). A signal's copies replace it at its place; the values of the last sweep
    change fastest. Raises StudyError if a sweep is wrong, or if there are too many signals.
    """
    tables = [read_section(SweepTable, raw, f"sweep[{i}]") for i, raw in enumerate(sweeps, start=1)]
    for i, sweep in enumerate(tables, start=1):
        key, values_key = f"sweep[{i}].key", f"sweep[{i}].values"
        head, _, tail = sweep.key.partition(".")
        has_one_key = bool(tail) and "." not in tail
        if not (has_one_key if head in _INNER_TABLES else head in _FILE_KEYS and not tail):
            right = 'it must be like "simulate.noise_sd", "system.gravity" or "start"'
            raise StudyError(key, f"is {show(sweep.key)}, which is not a key of a signal; {right}")
        if not any(_applies(sweep.key, signal) for signal in signals):
            raise StudyError(key, f"is {show(sweep.key)}, which no signal has; sweep a key that a signal has")
        names = [suffix(sweep.key, value, sweep.values) for value in sweep.values]
        if len(set(names)) != len(names):
            what = f"repeats a value: {show(list(sweep.values))}; give each value once"
            raise StudyError(values_key, what)
    applicable = [[sweep for sweep in tables if _applies(sweep.key, signal)] for signal in signals]
    count = sum(math.prod(len(s.values) for s in applying) for applying in applicable)
    if count > MOST_SIGNALS:
        right = f"at most {MOST_SIGNALS} are allowed. Sweep fewer values"
        raise StudyError("sweep", f"expands to {count} signals; {right}")
    expanded = []
    for signal, applying in zip(signals, applicable, strict=True):
        for values in product(*(sweep.values for sweep in applying)):
            table = copy.deepcopy(signal)
            for sweep, value in zip(applying, values, strict=True):
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
    """Return whether a sweep's key applies to a signal.

    `system.*` applies to every signal, `simulate.*` to simulated ones, any other key to records from files.
    """
    head = key.partition(".")[0]
    return head == "system" or (head in signal if head == "simulate" else "file" in signal)


def suffix(key: str, value: object, values: tuple[Any, ...]) -> str:
    """Return the suffix that a sweep adds to a signal's name, such as `-noise_sd-0p003` for simulate.noise_sd = 0.003.

    A decimal point becomes p, a leading minus becomes m, and any other character that is not valid in a name becomes _.
    If the value is a table or a list, the suffix has its number among the values of the sweep, from 1.
    """
    if isinstance(value, dict | list):
        text = str(values.index(value) + 1)
    elif isinstance(value, float):
        text = repr(value).removesuffix(".0")
    else:
        text = str(value)
    text = as_name(text.replace("-", "m", text.startswith("-")).replace(".", "p"))
    return f"-{key.rpartition('.')[2]}-{text}"
