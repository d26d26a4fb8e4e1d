"""The folder of a comparison of envelopes: what it was asked, and its page made anew from its verdicts."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bayesdamp.envelope.report.page import EMBEDDED, page
from bayesdamp.store.files import write_bytes, write_json
from bayesdamp.types import InputError
from bayesdamp.verdict.files import JSON, read

KIND = "envelopes"
RUN, PAGE, FIGURES = "run.json", "report.html", "figures"


def asks_another(folder: Path, records: Sequence[Path], options: Mapping[str, Any]) -> bool:
    """Whether a folder has the answer to another question than that of these records read with these options."""
    if not (folder / RUN).exists():
        return (folder / JSON).exists() or (folder / PAGE).exists()  # as earlier versions left it
    about = _about(folder)
    return about is None or about.get("asked") != _asked(folder, records, options)


def write_about(
    folder: Path, records: Sequence[Path], options: Mapping[str, Any], pictures: Sequence[str],
    settings: Sequence[str],
) -> None:  # fmt: skip
    """Write run.json. pictures: name of each record's picture; settings: what was assumed, a sentence each."""
    about = {
        "kind": KIND,
        "name": folder.name,
        "asked": _asked(folder, records, options),
        "inputs": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in records},
        "pictures": list(pictures),
        "settings": list(settings),
    }
    write_json(folder / RUN, about)


def is_envelopes(folder: Path) -> bool:
    """Whether a folder is that of a comparison of envelopes."""
    return _about(folder) is not None


def make_page(folder: Path) -> Path:
    """Write report.html from the folder's verdicts and pictures; nothing is computed. Raises InputError."""
    about = _about(folder) or {}
    try:
        found = read(folder / JSON)
        pictures = [str(one) for one in about["pictures"]]
        if len(pictures) not in (len(found), len(found) - 1):  # with a specimen's behind those of the records
            raise ValueError
    except OSError as error:
        raise InputError(f"{folder / JSON}: {(error.strerror or str(error)).lower()}") from None
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(
            f"{folder}: its {JSON} and {RUN} are not as compare wrote them; compare the records again"
        ) from None
    title = str(about.get("name") or folder.resolve().name)
    settings = [str(one) for one in about.get("settings", ())]
    files = {key: f"{FIGURES}/{key}.png" for key in pictures}
    held = {}
    if len(found) <= EMBEDDED:
        held = {key: (folder / at).read_bytes() for key, at in files.items() if (folder / at).is_file()}
    write_bytes(folder / PAGE, page(title, found, held, files, settings))
    return folder / PAGE


def _about(folder: Path) -> dict[str, Any] | None:
    """What run.json holds; None where it is none of a comparison of envelopes."""
    try:
        found = json.loads((folder / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) and found.get("kind") == KIND else None


def _asked(folder: Path, records: Sequence[Path], options: Mapping[str, Any]) -> dict[str, Any]:
    """Records by their way from the folder: both may move together."""
    files = [Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix() for path in records]
    return json.loads(json.dumps({"records": files, **options}))
