"""Define `bayesdamp init`, which writes a commented study that compares files as `bayesdamp compare` does."""

import json
import os
import shlex
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from bayesdamp.cli.border import printable
from bayesdamp.cli.files import check_names
from bayesdamp.cli.records import ReadingOptions, select_records, study_signals, with_reading_options
from bayesdamp.config.load import RecordOptions, comparison_tables, resolve_study
from bayesdamp.config.study import (
    EstimatorsTable,
    EvidenceTable,
    Header,
    ModelsTable,
    PosteriorTable,
    SignalTable,
    StudySection,
)
from bayesdamp.store.files import write_bytes
from bayesdamp.types import InputError

_TABLES: dict[str, tuple[type[StudySection], str]] = {
    "estimators": (
        EstimatorsTable,
        'Estimators to run in addition to the comparison; use = "all" runs all eleven.',
    ),
    "models": (ModelsTable, "Which damping laws are compared."),
    "posterior": (PosteriorTable, "How the posterior is sampled."),
    "evidence": (EvidenceTable, "How damping models are compared, and when nested sampling is used as well."),
}
"""Tables of a study file that are written after its signals, by name: the class that defines the keys of the table, and
a comment for the file."""


def study_text(records: Sequence[RecordOptions], out: Path) -> str:
    """Return the text (TOML) of a study of these records, whose files are in the folder of the study file `out`.

    It has the settings of `bayesdamp compare --exact`, each with a comment. Nothing is checked or written.
    """
    tables = comparison_tables([{**asked, "file": Path(asked["file"]).name} for asked in records])
    typed, of = printable(shlex.quote(out.name)), printable(Path(records[0]["file"]).name)
    lines = [
        f"# A study of {of} with the settings of `bayesdamp compare --exact`. Correct what is wrong, then run",
        f"#   bayesdamp check {typed}    to check it for errors",
        f"#   bayesdamp study {typed}    to compute it in minutes; with --quick only the answer, in seconds",
        "",
    ]
    header = {key: value for key, value in tables.items() if not isinstance(value, dict | list)}
    lines += [_line(Header, key, value) for key, value in header.items()]
    last = ("specimen", "restoring", "system")  # the last keys of a [[signal]]
    for signal in tables["signal"]:
        given = signal | {key: signal.get(key, "auto") for key in ("clock", "start", "stop")}
        keys = [*(key for key in given if key not in last), *(key for key in last if key in given)]
        lines += ["", "[[signal]]", *(_line(SignalTable, key, given[key]) for key in keys)]
    for name, (section, what) in _TABLES.items():
        lines += ["", f"# {what}", f"[{name}]"]
        lines += [_line(section, key, value) for key, value in tables[name].items()]
    return "\n".join(lines) + "\n"


def _line(section: type[StudySection], key: str, value: object) -> str:
    """Return the line `key = value` of a study file, with the description of the key in `section` as a comment."""
    text = f"{key} = {to_toml(value)}"
    return f"{text:<48} # {section.model_fields[key].description}"


def to_toml(value: object) -> str:
    """Convert a value (text, number, bool, list or mapping of these) to the text for a TOML file, on one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {to_toml(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(to_toml, value)) + "]"
    return repr(value)


@with_reading_options
def init(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Files of measured decays, all in one folder.")
    ],
    **reading: Any,
) -> int:
    """Write a commented study file for records, next to them; nothing is computed or overwritten."""
    from bayesdamp.pipeline.run import read_records  # imports slowly

    check_names(files)
    file = files[0]
    other = next((path for path in files if path.absolute().parent != file.absolute().parent), None)
    if other is not None:
        raise InputError(f"{other}: is in another folder than {file}; a study reads files in its own folder")
    if not file.name:
        raise InputError(f"{file}: is a folder, not a file; give one of the files in it")
    out = file.with_suffix(".toml")
    options = ReadingOptions(**reading)
    chosen = select_records(files, options)
    if chosen.failed:
        raise chosen.failed[0]
    for line in [*chosen.doubted, *chosen.notes]:
        typer.echo(line, err=True)
    text = study_text(study_signals(chosen.records, options), out)
    try:
        study = resolve_study(tomllib.loads(text), out)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    read_records(study)
    if os.path.lexists(out):
        raise InputError(f"{out}: already exists and is not overwritten; move it away first")
    write_bytes(out, text.encode())
    typed = shlex.quote(str(out))
    typer.echo(f"{out} is written; next: bayesdamp check {typed} and bayesdamp study {typed}")
    return 0
