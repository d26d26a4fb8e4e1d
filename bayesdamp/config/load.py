"""The whole study file: reading it, and what comes out."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bayesdamp.config.again import read_asked
from bayesdamp.config.checks import (
    StudyError,
    below,
    distinct,
    known_keys,
    plugin_name,
    prior,
    section,
    shown,
    table,
)
from bayesdamp.config.published import Published, read_published
from bayesdamp.config.sections import (
    NAME,
    CalibrationTable,
    EstimatorsTable,
    EvidenceTable,
    Header,
    ModelsTable,
    PluginsTable,
    PosteriorTable,
    RecoveryTable,
)
from bayesdamp.config.signals import (
    canonical_models,
    check_base,
    damping_order,
    resolve_signal,
    restoring_laws,
)
from bayesdamp.config.study import Estimators, Models, SignalSpec, Study
from bayesdamp.config.sweeps import expand
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plain_text import read_plain
from bayesdamp.plugins import PluginModule, Registry, read_modules, use
from bayesdamp.types import InputError
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


_TABLES = (
    "system",
    "signal",
    "sweep",
    "estimators",
    "models",
    "posterior",
    "evidence",
    "calibration",
    "recovery",
    "plugins",
)


def _read(path: Path) -> dict[str, Any]:
    try:
        raw = tomllib.loads(read_plain(path, "the path of a study file (TOML)"))
    except tomllib.TOMLDecodeError as error:
        what, place = re.fullmatch(r"(.*?)(?: \(at (.*)\))?", str(error), re.DOTALL).groups()  # type: ignore[union-attr]
        raise StudyError(
            place or "", f"is not TOML: {what[:1].lower()}{what[1:]}; write key = value"
        ) from None
    except (
        ValueError,
        RecursionError,
    ) as error:  # an endless number, tables a thousand deep
        raise StudyError("", f"is not TOML that can be read ({error}); write key = value") from None
    if not raw:
        raise StudyError("", "is empty; a study starts with version = 1 and has at least one [[signal]]")
    return raw


def _list_of_tables(raw: dict[str, Any], name: str) -> list[dict[str, Any]]:
    entries = raw.get(name, [])
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise StudyError(name, f"is {shown(entries)}; it must be tables that start with [[{name}]]")
    return entries


def _signals(raw: dict[str, Any], folder: Path, laws: tuple[str, ...]) -> tuple[SignalSpec, ...]:
    written = _list_of_tables(raw, "signal")
    lists = [entry["restoring"] for entry in written if isinstance(entry.get("restoring"), list)]
    own = [law for laws in lists for law in laws if law in LAWS.names()]  # others are told with their signal
    base = check_base(raw.get("system", {}), (*laws, *own))
    if not written:
        raise StudyError("signal", "is missing; a study has at least one [[signal]]")
    signals = []
    for place, entry in enumerate(expand(written, _list_of_tables(raw, "sweep")), start=1):
        label = entry.get("name")
        label = label if isinstance(label, str) and re.fullmatch(NAME, label) else str(place)
        signals.append(resolve_signal(entry, base, folder, f"signal[{label}]", laws))
    distinct((s.name for s in signals), "signal", "the signal")
    return tuple(signals)


def _estimators(raw: object) -> Estimators:
    from bayesdamp.estimators import ESTIMATORS, names_for_all

    given = table(raw, "estimators")
    own = list(EstimatorsTable.model_fields)
    variants = {
        name: _variant(name, options["variant_of"])
        for name, options in given.items()
        if isinstance(options, dict) and "variant_of" in options and name not in own
    }
    known_keys(given, [*own, *ESTIMATORS.names(), *variants], "estimators")
    checked = section(EstimatorsTable, {n: v for n, v in given.items() if n in own}, "estimators")
    use = tuple(names_for_all()) if checked.use == "all" else checked.use
    for name in use:
        if name not in variants:
            plugin_name(ESTIMATORS, name, "estimators.use")
    distinct(use, "estimators.use", "the estimator")
    distinct(checked.stages, "estimators.stages", "the stage")
    known_keys(checked.repeats, list(use), "estimators.repeats")
    options = {n: table(v, below("estimators", n)) for n, v in given.items() if n not in own}
    options = {n: {k: v for k, v in o.items() if k != "variant_of"} for n, o in options.items()}
    return Estimators(use, checked.stages, options, checked.repeats, variants)


def _variant(name: str, method: object) -> str:
    """The estimator that a study runs under a name of its own, checked."""
    from bayesdamp.estimators import ESTIMATORS

    key = below("estimators", name)
    if name in ESTIMATORS.names():
        raise StudyError(key, "is an estimator's own name; a variant needs another, such as sindy_sign")
    if not re.fullmatch(NAME, name):
        raise StudyError(key, "is no name of a variant; it must be letters, digits, - and _")
    if not isinstance(method, str):
        raise StudyError(
            below(key, "variant_of"), f"is {shown(method)}; it must be an estimator's name in quotes"
        )
    plugin_name(ESTIMATORS, method, below(key, "variant_of"))
    return method


def _models(raw: object) -> Models:
    from bayesdamp.physics.damping import TERMS, all_sums

    checked = section(ModelsTable, raw, "models")
    names = all_sums() if checked.compare == "all" else checked.compare
    compare = canonical_models(tuple(names), "models.compare")
    further = [p.name for t in damping_order() for p in TERMS.get(t).inferred]
    known_keys(checked.prior, [*damping_order(), *further], "models.prior")
    return Models(
        compare,
        {n: prior(v, f"models.prior.{n}", negative=n in further) for n, v in checked.prior.items()},
        restoring_laws(checked.restoring or (), "models.restoring"),
        checked.prune,
    )


def _check_plugins(registry: Registry[Any], names: Sequence[str], key: str, what: str) -> None:
    for name in names:
        plugin_name(registry, name, key)
    distinct(names, key, what)


def load_study(path: str | Path, plugins: Sequence[PluginModule] = ()) -> Study:
    """Read and check a study file. Files of signals, and modules of plug-ins, are looked for beside it.

    path: of a TOML file, or of the run.json of a run, which asks the same again. plugins: modules besides those that
    the file names.
    Raises InputError: one line with the file, the key, what is wrong and what would be right.
    """
    path = Path(path)
    try:
        if path.suffix != ".json":
            return resolve_study(_read(path), path, plugins)
        asked = read_asked(path)
        study = resolve_study(dict(asked.tables), asked.beside / path.name, plugins)
        missing = asked.plugins.keys() - {m.digest for m in study.plugins}
        if missing:
            what = f"the run had the plug-in {asked.plugins[min(missing)]}, which is missing or has changed"
            raise InputError(f"{what}; give it with --plugin")
        return study
    except (StudyError, InputError) as error:
        raise InputError(str(error), str(path)) from None


def resolve_study(raw: dict[str, Any], path: Path, plugins: Sequence[PluginModule] = ()) -> Study:
    """The study that the tables of a file say. path: of that file; signals' files are looked for beside it.

    plugins: modules besides those that it names; all of these, and no others, are in use from here on.
    Raises StudyError and InputError without the file's name.
    """
    from bayesdamp.estimators import ESTIMATORS
    from bayesdamp.inference.evidence import EVIDENCES
    from bayesdamp.inference.noise import NOISES
    from bayesdamp.inference.samplers import SAMPLERS

    header = section(Header, {n: v for n, v in raw.items() if n in Header.model_fields}, "")
    known_keys(raw, [*Header.model_fields, *_TABLES], "")
    named = section(PluginsTable, raw.get("plugins", {}), "plugins").modules or ()
    modules = tuple(dict.fromkeys((*read_modules(named, path.parent), *plugins)))
    use(modules)
    name = header.name if header.name is not None else re.sub(r"[^A-Za-z0-9_-]", "_", path.stem)
    models = _models(raw.get("models", {}))
    signals = _signals(raw, path.parent, models.restoring)
    estimators = _estimators(raw.get("estimators", {}))
    published: tuple[Published, ...] = ()
    if header.published is not None:
        methods = [*ESTIMATORS.names(), *estimators.variants]
        published = read_published(path.parent / header.published, [s.name for s in signals], methods)
    posterior = section(PosteriorTable, raw.get("posterior", {}), "posterior")
    _check_plugins(SAMPLERS, posterior.samplers, "posterior.samplers", "the sampler")
    if posterior.noise != "auto":
        noises = (posterior.noise,) if isinstance(posterior.noise, str) else posterior.noise
        _check_plugins(NOISES, noises, "posterior.noise", "the noise model")
    evidence = section(EvidenceTable, raw.get("evidence", {}), "evidence")
    _check_plugins(EVIDENCES, evidence.methods, "evidence.methods", "the method")
    calibration = section(CalibrationTable, raw.get("calibration", {}), "calibration")
    _check_plugins(SAMPLERS, calibration.samplers, "calibration.samplers", "the sampler")
    study = Study(
        source=path,
        name=name,
        signals=signals,
        estimators=estimators,
        models=models,
        posterior=posterior,
        evidence=evidence,
        seed=header.seed,
        description=header.description,
        published=published,
        calibration=calibration,
        recovery=section(RecoveryTable, raw.get("recovery", {}), "recovery"),
        plugins=modules,
        tables=raw,
    )
    for spec in study.signals:
        for model in spec.estimate or ():
            if model not in study.dampings(spec):
                what = f"names {model}, which this signal does not compare"
                raise StudyError(f"signal[{spec.name}].estimate", f"{what}; it must be one of its models")
    check_specimens(
        study.every_specimen, {s.name: study.dampings(s) for s in study.signals}, bool(raw.get("sweep"))
    )
    if "laplace" not in study.evidence.methods:
        for key, value in (
            ("models.prune", study.models.prune),
            ("posterior.best", study.posterior.best),
        ):
            if value is not None:
                raise StudyError(key, 'needs "laplace" among evidence.methods; name it there')
    return study
