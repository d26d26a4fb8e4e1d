"""A run's run.json as the study that it was: the same question, asked again."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bayesdamp.config.checks import StudyError

if TYPE_CHECKING:
    from bayesdamp.config.study import Study


@dataclass(frozen=True)
class Asked:
    """What a run was asked. tables: those of its study file; beside: the folder in which its files are looked for;
    plugins: files of the user's modules by their digests."""

    tables: Mapping[str, Any]
    beside: Path
    plugins: Mapping[str, str]


def asked(study: Study, folder: Path) -> dict[str, Any]:
    """As run.json in a run's folder holds it. The way to the study's files is relative: both move together."""
    beside = Path(os.path.relpath(study.source.parent.resolve(), folder.resolve())).as_posix()
    return {"tables": dict(study.tables), "beside": beside}


def asks_another(study: Study, folder: Path) -> bool:
    """Whether a folder has the run of another study than this one."""
    try:
        run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return False
    except (OSError, ValueError, RecursionError):
        return True
    return not isinstance(run, dict) or run.get("asked") != json.loads(json.dumps(asked(study, folder)))


def read_asked(path: Path) -> Asked:
    """What a run.json says was asked. Raises StudyError where it is none, or where an input is not what it was."""
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StudyError("", "there is no such file; give a study file (TOML), or a run's run.json") from None
    except (OSError, ValueError, RecursionError):
        raise StudyError("", "is no JSON; give a study file (TOML), or a run's run.json") from None
    try:
        tables, beside = {"name": run.get("name"), **run["asked"]["tables"]}, run["asked"].get("beside", ".")
        inputs = dict(run.get("inputs", {}))
        plugins = {one["sha256"]: one["file"] for one in run.get("study", {}).get("plugins", ())}
    except (AttributeError, KeyError, TypeError, ValueError):
        what = "does not hold the study that it was made from"
        raise StudyError("", f"{what}; give that study file (TOML), or a run.json of this version") from None
    return Asked(tables, _folder(path.parent, str(beside), inputs), plugins)


def _folder(folder: Path, beside: str, inputs: Mapping[str, str]) -> Path:
    """Where the run's inputs lie: where they were, else in the run's folder, else here. Raises StudyError."""
    places = (folder / beside, folder, Path())
    for name, digest in inputs.items():
        there = [place / name for place in places if (place / name).is_file()]
        if not there:
            raise StudyError("", f"{name} is not there any more; put the file of that run beside it")
        if hashlib.sha256(there[0].read_bytes()).hexdigest() != digest:
            raise StudyError("", f"{name} is another file than the run was made from; put that one beside it")
    if not inputs:
        return places[0] if places[0].is_dir() else folder
    return next((place for place in places if all((place / name).is_file() for name in inputs)), places[0])
