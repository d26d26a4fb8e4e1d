"""Read a study from a TOML file, from the run.json of a run, or by the name of a study of the package.

Also build the study that the command `compare` runs: all parameters are inferred, and none is taken as known. By
default it compares all damping sums (sums of damping terms, such as viscous+coulomb) under all restoring laws."""

import csv
import hashlib
import io
import json
import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bayesdamp.config.checks import (
    StudyError,
    check_distinct,
    check_keys,
    check_plugins,
    check_table,
    join_keys,
    read_prior,
    read_section,
)
from bayesdamp.config.signals import (
    canonical_models,
    check_base,
    check_laws,
    damping_order,
    expand,
    resolve_signal,
)
from bayesdamp.config.study import (
    NAME,
    CalibrationTable,
    Estimators,
    EstimatorsTable,
    EvidenceTable,
    Header,
    ModelsTable,
    PluginsTable,
    PosteriorTable,
    Recording,
    RecoveryTable,
    SignalSpec,
    Study,
    as_name,
)
from bayesdamp.estimators import ESTIMATORS
from bayesdamp.formatting import listing, show
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS
from bayesdamp.physics.damping import PAPER_TERMS, TERMS, all_sums
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plain_text import read_plain
from bayesdamp.plugins import PluginModule, nearest, read_modules, use_modules
from bayesdamp.types import SENSOR, UNITS, InputError, unit_named

PACKAGE = Path(__file__).resolve().parents[1]
_SETTINGS = {
    "posterior": PosteriorTable, "evidence": EvidenceTable, "calibration": CalibrationTable, "recovery": RecoveryTable,
}  # fmt: skip
"""Classes of the tables with settings for single steps of a run, by the name of the table; each is checked separately.
"""
_TABLES = ("system", "signal", "sweep", "estimators", "models", *_SETTINGS, "plugins")
_PUBLISHED = ("estimator", "signal", "error_pct", "time")
"""Columns of a CSV file of published results: the estimator, the signal, the error in per cent, the computing time."""
_NO_STUDY = "give a study file (TOML), or a run's run.json"
PRUNE_NATS = 20.0
"""In a comparison, a candidate (a sum of damping terms under a restoring law) is left out of everything after the
answer (estimate, fit, chains, full evidence) if its log evidence is at least this far below the largest, in nats: its
relative probability is then at most 2e-9. For this test the evidence is computed by linear approximations."""
SAMPLED_CANDIDATES = 2
"""Number of candidates (sums of damping terms under a restoring law) that the NUTS chains of a comparison sample, the
most probable ones; the sampled answer has its own rule."""
WARMUP, DRAWS = 100, 500
"""`WARMUP`: number of first draws of each of the four NUTS chains of a comparison, which are discarded. `DRAWS`: number
of draws of each chain that are used. They are nearly independent, because the sampler works in whitened coordinates; if
they are not, it adds draws."""
LEAST_NOISE = 1e-3
"""Standard deviation of the noise that is added to a record without noise, as a fraction of the amplitude. Noise is
needed to compute a likelihood; this value is typical of a good encoder."""
SPECIMEN = "specimen"
"""Name of the specimen (the tested object) in a study whose records are all repeated tests of one object."""
RecordOptions = Mapping[str, Any]
"""Options for one record, by the keys of [[signal]] in a study: its file and how to read it. None stands for a missing
value. A `label` distinguishes several records in a file. Without a unit, an envelope has the unit of its file, and any
other record is in rad."""


def shipped_folder() -> Path:
    """Return the folder of the package's studies: in the installed package, or next to it in a clone."""
    own = PACKAGE / "studies"
    return own if own.is_dir() else PACKAGE.parent / "studies"


def study_file(given: Path) -> Path:
    """Return the given path if it exists, otherwise the path of the study with this name in the package.

    The name may end in .toml. A path with a folder or another suffix, and an unknown name that ends in .toml, are
    returned as they are. Raises InputError for an unknown name without a suffix.
    """
    if given.exists() or len(given.parts) != 1 or given.suffix not in ("", ".toml"):
        return given
    names = sorted(path.stem for path in shipped_folder().glob("*.toml"))
    if given.stem in names:
        return shipped_folder() / f"{given.stem}.toml"
    if given.suffix:
        return given
    raise InputError(
        f"{given}: no such file, and no study of bayesdamp has this name{nearest(given.name, names)}"
    )


def record_question(study: Study, folder: Path) -> dict[str, Any]:
    """Return the entry `asked` of run.json, from which the study can be run again.

    Its key `tables` contains the tables of the study file, `beside` the path of the folder of the study's files. This
    path is relative to `folder`, the folder of the run, so that both folders can be moved together.
    """
    beside = Path(os.path.relpath(study.source.parent.resolve(), folder.resolve())).as_posix()
    return {"tables": dict(study.tables), "beside": beside}


def has_other_study(study: Study, folder: Path) -> bool:
    """Return whether a folder contains the run of a different study, or a run.json that cannot be read.

    Studies are different if their tables or the folders of their files differ. Return False if there is no run.json.
    """
    try:
        run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return False
    except (OSError, ValueError, RecursionError):
        return True
    question = json.loads(json.dumps(record_question(study, folder)))
    return not isinstance(run, dict) or run.get("asked") != question


def _read_question(path: Path) -> tuple[dict[str, Any], Path, dict[str, str]]:
    """Read a study from a run.json.

    Returns the tables of the study, the folder of its files, and the names of the user's modules by their SHA-256. The
    folder is the first that contains all input files unchanged, of: that of the run's time, that of the run.json, the
    working directory. Raises StudyError if there is none, or if the file cannot be read or contains no study.
    """
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StudyError("", f"there is no such file; {_NO_STUDY}") from None
    except (OSError, ValueError, RecursionError):
        raise StudyError("", f"is not JSON; {_NO_STUDY}") from None
    try:
        tables, beside = {"name": run.get("name"), **run["asked"]["tables"]}, run["asked"].get("beside", ".")
        inputs = dict(run.get("inputs", {}))
        plugins = {module["sha256"]: module["file"] for module in run.get("study", {}).get("plugins", ())}
    except (AttributeError, KeyError, TypeError, ValueError):
        what = "does not contain the study of the run"
        raise StudyError("", f"{what}; give that study file (TOML), or a run.json of this version") from None
    # Look for the inputs in their old folder, in the folder of the run, and in the working directory.
    folders = (path.parent / str(beside), path.parent, Path())
    complete = [f for f in folders if f.is_dir() and all((f / name).is_file() for name in inputs)]
    if not complete:
        nowhere = (name for name in inputs if not any((f / name).is_file() for f in folders))
        missing = next(nowhere, next(name for name in inputs if not (path.parent / name).is_file()))
        raise StudyError("", f"the input file {missing} of the run is missing; put it next to run.json")
    changed: list[str] = []
    for folder in complete:
        changed = [n for n in inputs if hashlib.sha256((folder / n).read_bytes()).hexdigest() != inputs[n]]
        if not changed:
            return tables, folder, plugins
    raise StudyError("", f"{changed[0]} has changed since the run; put its earlier version next to run.json")


def load_study(path: str | Path, plugins: Sequence[PluginModule] = ()) -> Study:
    """Read and check a study file, and register its plug-ins. Paths in it are relative to its folder.

    Parameters
    ----------
    path
        A TOML file, or (with the suffix .json) the run.json of a run, which repeats the study of that run; its input
        files and plug-ins must be unchanged.
    plugins
        Modules of plug-ins besides those that the file names.

    Returns
    -------
    Study
        The checked study.

    Raises
    ------
    InputError
        The file cannot be read, or the study is wrong. The message names the file, the key, the error and the valid
        values.
    """
    path = Path(path)
    try:
        if path.suffix == ".json":
            tables, folder, modules = _read_question(path)
            study = resolve_study(tables, folder / path.name, plugins)
            missing = modules.keys() - {m.digest for m in study.plugins}
            if missing:
                what = f"the file of the run's plug-in {modules[min(missing)]} is missing or has changed"
                raise InputError(f"{what}; give the file as it was in the run with --plugin")
            return study
        try:
            tables = tomllib.loads(read_plain(path, "the path of a study file (TOML)"))
        except tomllib.TOMLDecodeError as error:
            what, place = re.fullmatch(r"(.*?)(?: \(at (.*)\))?", str(error), re.DOTALL).groups()  # type: ignore[union-attr]
            what = f"is not TOML: {what[:1].lower()}{what[1:]}; write key = value"
            raise StudyError(place or "", what) from None
        except (ValueError, RecursionError) as error:
            # Such as a number that is too long, or deeply nested tables.
            raise StudyError("", f"is not TOML that can be read ({error}); write key = value") from None
        if not tables:
            raise StudyError("", "is empty; a study starts with version = 1 and has at least one [[signal]]")
        return resolve_study(tables, path, plugins)
    except InputError as error:
        raise InputError(str(error), str(path)) from None


def resolve_study(raw: dict[str, Any], path: Path, plugins: Sequence[PluginModule] = ()) -> Study:
    """Check the tables of a study file and return the study.

    Parameters
    ----------
    raw
        The tables of the file.
    path
        The file. Paths in it are relative to its folder.
    plugins
        Modules of plug-ins besides those that the file names. After the call the plug-ins of all these modules are
        registered, and those of all other modules of users are removed.

    Returns
    -------
    Study
        The checked study.

    Raises
    ------
    StudyError, InputError
        The study is wrong. The message does not name the file.
    """
    header = read_section(Header, {n: v for n, v in raw.items() if n in Header.model_fields}, "")
    check_keys(raw, [*Header.model_fields, *_TABLES], "")
    named = read_section(PluginsTable, raw.get("plugins", {}), "plugins").modules or ()
    modules = tuple(dict.fromkeys((*read_modules(named, path.parent), *plugins)))
    use_modules(modules)
    table = read_section(ModelsTable, raw.get("models", {}), "models")
    sums = canonical_models(table.compare, "models.compare")
    further = [p.name for t in damping_order() for p in TERMS.get(t).inferred]
    check_keys(table.prior, [*damping_order(), *further], "models.prior")
    priors = {n: read_prior(v, f"models.prior.{n}", negative=n in further) for n, v in table.prior.items()}
    check_laws(table.restoring, "models.restoring")
    models = table.model_copy(update={"compare": sums, "prior": priors})
    signals = _read_signals(raw, path.parent, models.restoring)
    estimators = _read_estimators(raw.get("estimators", {}))
    settings: dict[str, Any] = {n: read_section(kind, raw.get(n, {}), n) for n, kind in _SETTINGS.items()}
    posterior: PosteriorTable = settings["posterior"]
    noises = (posterior.noise,) if isinstance(posterior.noise, str) else posterior.noise
    for registry, names, key, what in (
        (SAMPLERS, posterior.samplers, "posterior.samplers", "the sampler"),
        (NOISES, () if posterior.noise == "auto" else noises, "posterior.noise", "the noise model"),
        (EVIDENCES, settings["evidence"].methods, "evidence.methods", "the method"),
        (SAMPLERS, settings["calibration"].samplers, "calibration.samplers", "the sampler"),
    ):
        check_plugins(registry, names, key)
        check_distinct(names, key, what)
    study = Study(
        source=path,
        name=header.name if header.name is not None else as_name(path.stem),
        signals=signals,
        estimators=estimators,
        models=models,
        seed=header.seed,
        description=header.description,
        published=() if header.published is None else _read_published(path.parent / header.published),
        **settings,
        plugins=modules,
        tables=raw,
    )
    _check_across_tables(study)
    return study


def _read_signals(raw: dict[str, Any], folder: Path, laws: tuple[str, ...]) -> tuple[SignalSpec, ...]:
    """Return the signals of a study: its tables [[signal]], completed by [system], and repeated for each [[sweep]].

    raw: all tables of the study file. folder: folder of the study file. laws: the restoring laws of [models], which
    apply to every signal without its own. Raises StudyError if a table is wrong or a name is repeated.
    """

    def tables_of(name: str) -> list[dict[str, Any]]:
        entries = raw.get(name, [])
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise StudyError(name, f"is {show(entries)}; it must be tables that start with [[{name}]]")
        return entries

    entries = tables_of("signal")
    lists = [entry["restoring"] for entry in entries if isinstance(entry.get("restoring"), list)]
    # Unknown laws are reported later, with their signal.
    known = [law for names in lists for law in names if law in LAWS.names()]
    base = check_base(raw.get("system", {}), (*laws, *known))
    if not entries:
        raise StudyError("signal", "is missing; a study has at least one [[signal]]")
    signals = []
    for number, entry in enumerate(expand(entries, tables_of("sweep")), start=1):
        label = entry.get("name")
        label = label if isinstance(label, str) and re.fullmatch(NAME, label) else str(number)
        signals.append(resolve_signal(entry, base, folder, f"signal[{label}]", laws))
    check_distinct((s.name for s in signals), "signal", "the signal")
    return tuple(signals)


def _read_estimators(raw: object) -> Estimators:
    """Return the estimators that the table [estimators] names in `use`, with their options.

    Raises StudyError if the table is wrong. Without `use`, or if the table is empty, these are the eleven methods of
    the paper (`names_for_all`). Options of an estimator are in a table with its name. A variant is an estimator with
    other options, under a new name: a table with this name, in which `variant_of` gives the estimator and all other
    keys are options.
    """
    given = check_table(raw, "estimators")
    own = list(EstimatorsTable.model_fields)
    variants: dict[str, str] = {}
    for name, options in given.items():
        if name in own or not isinstance(options, dict) or "variant_of" not in options:
            continue
        key, method = join_keys("estimators", name), options["variant_of"]
        if name in ESTIMATORS.names():
            raise StudyError(key, "is an estimator's name; a variant needs another name, such as sindy_sign")
        if not re.fullmatch(NAME, name):
            raise StudyError(key, "is not a valid variant name; use letters, digits, - and _, not - first")
        key = join_keys(key, "variant_of")
        if not isinstance(method, str):
            raise StudyError(key, f"is {show(method)}; it must be an estimator's name in quotes")
        check_plugins(ESTIMATORS, [method], key)
        variants[name] = method
    check_keys(given, [*own, *ESTIMATORS.names(), *variants], "estimators")
    checked = read_section(EstimatorsTable, {n: v for n, v in given.items() if n in own}, "estimators")
    check_plugins(ESTIMATORS, [name for name in checked.use if name not in variants], "estimators.use")
    check_distinct(checked.use, "estimators.use", "the estimator")
    check_distinct(checked.stages, "estimators.stages", "the stage")
    check_keys(checked.repeats, checked.use, "estimators.repeats")
    options = {n: check_table(v, join_keys("estimators", n)) for n, v in given.items() if n not in own}
    options = {n: {k: v for k, v in o.items() if k != "variant_of"} for n, o in options.items()}
    return Estimators(**dict(checked), options=options, variants=variants)


def _read_published(path: Path) -> tuple[dict[str, str], ...]:
    """Return the rows of a CSV file of published results; each row is a dict from the name of a column to its text.

    Empty rows, and columns that are not in `_PUBLISHED`, are left out. Raises StudyError if the file cannot be read, or
    has not all columns in `_PUBLISHED`.
    """
    try:
        reader = csv.DictReader(io.StringIO(read_plain(path, "a CSV file"), newline=""))
        missing = set(_PUBLISHED) - set(reader.fieldnames or ())
        rows = [row for row in reader if any(row.values())]
    except (InputError, csv.Error) as error:
        raise StudyError("published", f"is {show(path.name)}, which cannot be read ({error})") from None
    if missing:
        what = f"is {show(path.name)}, which has no column {min(missing)}"
        raise StudyError("published", f"{what}; its columns must be {', '.join(_PUBLISHED)}")
    return tuple({column: row[column] or "" for column in _PUBLISHED} for row in rows)


def _check_across_tables(study: Study) -> None:
    """Raise StudyError if settings in different tables of a study contradict each other.

    Published results must be for estimators and signals of the study. The key `estimate` of a signal may name only
    damping sums that are compared on it. The records of a specimen (repeated tests of one object) must be different,
    and have the same base unit, the same damping sums and the same restoring laws; a study with a specimen must not
    have a sweep.
    """
    names = {
        "estimator": [*ESTIMATORS.names(), *study.estimators.variants],
        "signal": [spec.name for spec in study.signals],
    }
    for row in study.published:
        for column, valid in names.items():
            if row[column] not in valid:
                what = f"contains the unknown {column} {show(row[column])}{nearest(row[column], valid)}"
                raise StudyError("published", what)
    for spec in study.signals:
        for model in spec.estimate or ():
            if model not in study.dampings(spec):
                what = f"contains {model}, which this signal does not compare"
                raise StudyError(f"signal[{spec.name}].estimate", f"{what}; it must be one of its models")
    for name, (first, *others) in study.specimens.items():
        if study.tables.get("sweep"):
            what = "cannot be combined with a [[sweep]]; remove one of the two"
            raise StudyError(f"signal[{first.name}].specimen", what)
        read = [
            s.source.model_copy(update={"file": ""}) if isinstance(s.source, Recording) else s
            for s in (first, *others)
        ]
        for i, spec in enumerate(others, 1):
            key = f"signal[{spec.name}].specimen"
            if read[i] in read[:i]:
                same = (first, *others)[read.index(read[i])].name
                raise StudyError(key, f"signals {same} and {spec.name} are the same record; remove one")
            repeat = f"signals {spec.name} and {first.name} are of one specimen, {name!r}, but"
            if unit_named(spec.source.unit).base != unit_named(first.source.unit).base:
                units = f"{spec.source.unit} and {first.source.unit}"
                right = "repeats must all be angles, all lengths or all in one unit"
                raise StudyError(key, f"{repeat} in {units}; {right}")
            same = set(study.dampings(spec)) == set(study.dampings(first))
            if spec.restoring != first.restoring or not same:
                right = "repeats must have the same compare and restoring"
                raise StudyError(key, f"{repeat} compare different models; {right}")


def laws_for(unit: str) -> tuple[str, ...]:
    """Return the names of the restoring laws that are compared if the user names none.

    `unit` is the unit of the displacement, such as "mm". For an angle or an unknown unit the result has all laws; for
    any other unit it has the laws that also describe a translation. Several laws are compared because otherwise the
    misfit of a wrong restoring law could be mistaken for damping.
    """
    along = unit in UNITS and UNITS[unit].translates
    return tuple(n for n in LAWS.present() if not along or LAWS.get(n).translates)


def comparison_study(
    records: Sequence[RecordOptions], *, plugins: Sequence[PluginModule] = (), **settings: Any
) -> Study:
    """Return the study that compares sums of damping terms under restoring laws on each record.

    Parameters
    ----------
    records
        Files and how to read them (`RecordOptions`).
    plugins
        The user's modules. Unless `damping` is given, each damping term in them is compared alone, and in a sum with
        each of viscous, Coulomb and quadratic damping. Unless `restoring` is given, each restoring law in them is added
        to the laws that are compared.
    settings
        Further arguments of `comparison_tables`.

    Returns
    -------
    Study
        The checked study.

    Raises
    ------
    InputError
        A setting is wrong. The message names the option of the command.
    """
    use_modules(plugins)
    try:
        return resolve_study(comparison_tables(records, **settings), Path("compare"), plugins)
    except StudyError as error:
        option = re.sub(r"^signal\[[^\]]*\]\.(system\.)?|^models\.|^posterior\.", "", error.where)
        option = {"compare": "damping", "specimen": "repeats"}.get(option, option)
        raise InputError(error.what, f"--{option}" if option else "") from None


def comparison_tables(
    records: Sequence[RecordOptions],
    *,
    restoring: Sequence[str] = (),
    damping: Sequence[str] = (),
    noise: str = "auto",
    seed: int = 0,
    repeats: bool = False,
    deviation: str = "auto",
    sensor: float = SENSOR,
) -> dict[str, Any]:
    """Return the tables of the study that compares sums of damping terms under restoring laws on each record.

    Parameters
    ----------
    records
        Files and how to read them (`RecordOptions`).
    restoring
        Names of the restoring laws to compare; if empty, those that suit the record's unit (`laws_for`). They have no
        effect on envelopes.
    damping
        Damping sums to compare, such as "viscous+cubic"; if empty, the seven sums of viscous, Coulomb and quadratic
        damping, and those with the user's terms (see `comparison_study`).
    repeats
        If true, all records are tests of one specimen (tested object). If false, oscillations with the same key
        `specimen` are tests of one specimen, and the others have none.
    noise
        Name of the noise model, or "auto" to choose one for each record.
    seed
        Seed of all random numbers.
    deviation
        Whether the damping and restoring laws hold exactly ("none") or only approximately ("law"). "auto" allows
        deviations only in the answer on a measured record, not in samplers and evidence methods.
    sensor
        Relative linearity error of the sensor (standard deviation), which is added to the uncertainty of damping ratios
        where deviations are allowed; without effect on envelopes.

    Raises
    ------
    InputError
        If `repeats` is true and there are fewer than two records.
    """
    if repeats and len(records) < 2:
        raise InputError("--repeats: there is one record; give two or more of one specimen")
    signals: dict[str, dict[str, Any]] = {}
    for record in records:
        stem = _as_name(f"{Path(record['file']).stem} {record.get('label', '')}".strip()) or "record"
        name, number = stem, 2
        while name in signals:
            name, number = f"{stem}-{number}", number + 1
        given = {k: v for k, v in record.items() if k not in ("label", "specimen") and v is not None}
        signals[name] = signal = {"name": name, **given}
        is_envelope = record.get("quantity") == "envelope"
        if not is_envelope:
            laws = list(restoring) or list(laws_for(record.get("unit", "rad")))
            signal |= {"least_noise": LEAST_NOISE, "restoring": laws, "system": {"restoring": laws[0]}}
        specimen = _as_name(record.get("specimen", ""))
        if repeats:
            signal["specimen"] = SPECIMEN
        elif specimen and len(records) > 1 and not is_envelope:
            signal["specimen"] = specimen
    first, files = next(iter(signals)), list(dict.fromkeys(Path(record["file"]).name for record in records))
    shown = files if len(files) < 5 else [*files[:3], f"{len(files) - 3} more files"]
    study = first if len(records) == 1 else f"{first}-and-{len(records) - 1}-more"
    if len(records) > 1 and len({record["file"] for record in records}) == 1:
        study = f"{_as_name(Path(records[0]['file']).stem) or 'record'}-{len(records)}-records"
    added = TERMS.added()
    sums = all_sums() + [sum_ for term in added for sum_ in (term, *(f"{t}+{term}" for t in PAPER_TERMS))]
    return {
        "version": 1,
        "name": study,
        "seed": seed,
        "description": f"Damping of {listing(shown)}",
        "signal": list(signals.values()),
        "estimators": {"use": ["least_squares"], "stages": ["initial"]},
        "models": {"compare": list(damping) or sums, "prune": PRUNE_NATS},
        "posterior": {
            "samplers": ["nuts"],
            "noise": noise,
            "deviation": deviation,
            "sensor": sensor,
            "best": SAMPLED_CANDIDATES,
            "warmup": WARMUP,
            "draws": DRAWS,
        },
        "evidence": {"methods": ["importance", "bridge"], "referee": "auto"},
    }


def _as_name(label: str) -> str:
    """Convert a label to a valid name (`as_name`); "" if the label is empty.

    If the name has more than 48 characters, its middle is left out. If it would begin with -, a _ is added before it.
    """
    name = as_name(label)
    name = name if len(name) <= 48 else f"{name[:24]}-{name[-23:]}"
    return name if not name or re.match(r"\w", name) else f"_{name}"
