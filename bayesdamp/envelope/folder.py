"""The folder of a comparison of envelopes: what it was asked."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bayesdamp.store.described import ENVELOPES, RUN, read_description
from bayesdamp.store.files import write_json
from bayesdamp.types import InputError
from bayesdamp.verdict.files import JSON


def asks_another(folder: Path, records: Sequence[Path], options: Mapping[str, Any]) -> bool:
    """Whether a folder has the answer to another question than that of these records read with these options."""
    if not (folder / RUN).exists():
        return (folder / JSON).exists() or (folder / "report.html").exists()  # as earlier versions left it
    try:
        about = read_description(folder)
    except InputError:
        return True
    return about.get("kind") != ENVELOPES or about.get("asked") != _asked(folder, records, options)


def write_about(
    folder: Path, records: Sequence[Path], options: Mapping[str, Any], pictures: Sequence[str],
    settings: Sequence[str],
) -> None:  # fmt: skip
    """Write run.json. pictures: name of each record's picture; settings: what was assumed, a sentence each."""
    about = {
        "kind": ENVELOPES,
        "name": folder.name,
        "asked": _asked(folder, records, options),
        "inputs": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in records},
        "pictures": list(pictures),
        "settings": list(settings),
    }
    write_json(folder / RUN, about)


def _asked(folder: Path, records: Sequence[Path], options: Mapping[str, Any]) -> dict[str, Any]:
    """Records by their way from the folder: both may move together."""
    files = [Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix() for path in records]
    return json.loads(json.dumps({"records": files, **options}))
