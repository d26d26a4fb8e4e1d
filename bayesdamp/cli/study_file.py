"""The text of a study file: what `compare` asks, as TOML with comments."""

from __future__ import annotations

import json
import shlex
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bayesdamp.config.compare import Asked, comparison_tables
from bayesdamp.config.load import resolve_study
from bayesdamp.config.sections import (
    EstimatorsTable,
    EvidenceTable,
    Header,
    ModelsTable,
    PosteriorTable,
    Section,
    SignalTable,
)

_SECTIONS: dict[str, type[Section]] = {
    "estimators": EstimatorsTable,
    "models": ModelsTable,
    "posterior": PosteriorTable,
    "evidence": EvidenceTable,
}
_TABLES = {
    "estimators": 'Estimates beside the comparison; use = "all" runs the eleven methods.',
    "models": "Which damping laws are weighed against each other.",
    "posterior": "How the posterior is sampled.",
    "evidence": "How damping models are weighed, and when nested sampling is asked as well.",
}


def study_text(records: Sequence[Asked], out: Path) -> str:
    """The study of records whose files lie beside `out`, where it will be written. Raises InputError and StudyError
    where the study would not be one."""
    tables = comparison_tables([{**asked, "file": Path(asked["file"]).name} for asked in records])
    typed, of = _commented(shlex.quote(out.name)), _commented(Path(records[0]["file"]).name)
    lines = [
        f"# A study of {of}, as `bayesdamp compare --exact` would do it. Change what is wrong, then",
        f"#   bayesdamp check {typed}    reads it and says what is wrong with it",
        f"#   bayesdamp study {typed}    runs it, in minutes; with --quick the answer alone, in seconds",
        "",
    ]
    lines += [
        _line(Header, key, value) for key, value in tables.items() if not isinstance(value, dict | list)
    ]
    for signal in tables["signal"]:
        given = signal | {key: signal.get(key, "auto") for key in ("clock", "start", "stop")}
        lines += [
            "",
            "[[signal]]",
            *(_line(SignalTable, key, value) for key, value in _ordered(given).items()),
        ]
    for name, table in tables.items():
        if isinstance(table, dict):
            lines += ["", f"# {_TABLES.get(name, '')}".rstrip("# "), f"[{name}]"]
            lines += [_line(_SECTIONS[name], key, value) for key, value in table.items()]
    text = "\n".join(lines) + "\n"
    resolve_study(tomllib.loads(text), out)
    return text


def _commented(text: str) -> str:
    """A text as one line of a comment."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def _ordered(signal: Mapping[str, Any]) -> dict[str, Any]:
    last = ("specimen", "restoring", "system")
    return {k: v for k, v in signal.items() if k not in last} | {k: signal[k] for k in last if k in signal}


def _line(section: type[Section], key: str, value: object) -> str:
    text = f"{key} = {written(value)}"
    return f"{text:<48} # {section.model_fields[key].description}"


def written(value: object) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {written(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(written, value)) + "]"
    return repr(value)
