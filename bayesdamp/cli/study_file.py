"""Write the text of a study file: what `compare` asks, as TOML with comments."""

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
    SignalTable,
    StudySection,
)

_SECTIONS: dict[str, type[StudySection]] = {
    "estimators": EstimatorsTable,
    "models": ModelsTable,
    "posterior": PosteriorTable,
    "evidence": EvidenceTable,
}
_TABLES = {
    "estimators": 'Estimates beside the comparison; use = "all" runs the eleven methods.',
    "models": "Which damping laws are compared.",
    "posterior": "How the posterior is sampled.",
    "evidence": "How damping models are compared, and when nested sampling is used as well.",
}


def study_text(records: Sequence[Asked], out: Path) -> str:
    """Return the study of records whose files are in the folder of `out`, where it will be written.

    Raises
    ------
    InputError, StudyError
        Where the study would not be valid.
    """
    tables = comparison_tables([{**asked, "file": Path(asked["file"]).name} for asked in records])
    typed, of = _commented(shlex.quote(out.name)), _commented(Path(records[0]["file"]).name)
    lines = [
        f"# A study of {of}, as `bayesdamp compare --exact` would do it. Change what is wrong, then",
        f"#   bayesdamp check {typed}    reads it and reports errors",
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
            *(_line(SignalTable, key, value) for key, value in sorted(given.items(), key=_place)),
        ]
    for name, table in tables.items():
        if isinstance(table, dict):
            lines += ["", f"# {_TABLES.get(name, '')}".rstrip("# "), f"[{name}]"]
            lines += [_line(_SECTIONS[name], key, value) for key, value in table.items()]
    text = "\n".join(lines) + "\n"
    resolve_study(tomllib.loads(text), out)
    return text


def _commented(text: str) -> str:
    """Return a text as one line of a comment."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def _place(item: tuple[str, Any]) -> int:
    """Return the place of a key in a [[signal]]: these come last, in this order."""
    last = ("specimen", "restoring", "system")
    return last.index(item[0]) if item[0] in last else -1


def _line(section: type[StudySection], key: str, value: object) -> str:
    text = f"{key} = {written(value)}"
    return f"{text:<48} # {section.model_fields[key].description}"


def written(value: object) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {written(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(written, value)) + "]"
    return repr(value)
