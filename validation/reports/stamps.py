"""By which code each report was made: `reports/made.json`, and what has changed since."""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from bayesdamp.store import write_json
from validation.reports.recipes import RECIPES, Recipe

FILE = "made.json"
_BODIES = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True)
class Stamp:
    """digest: of the sources that made a report; revision: the commit of the tree; day: when, ISO 8601."""

    digest: str
    revision: str
    day: str


def digest(recipe: Recipe, root: Path) -> str:
    """SHA-256 of what a report's numbers depend on under a tree: its commands, code without comments and docstrings,
    and other files byte by byte."""
    found = hashlib.sha256("\0".join(recipe.commands).encode())
    for path in sorted(_files(recipe, root)):
        found.update(f"\0{path.relative_to(root).as_posix()}\0".encode())
        is_code = path.suffix == ".py"
        found.update(_without_words(path.read_text("utf-8")).encode() if is_code else path.read_bytes())
    return found.hexdigest()


def stamps(reports: Path) -> dict[str, Stamp]:
    """What is said of the reports in a folder; nothing where there is no file."""
    file = reports / FILE
    if not file.is_file():
        return {}
    said: Mapping[str, Mapping[str, str]] = json.loads(file.read_text(encoding="utf-8"))
    return {name: Stamp(**about) for name, about in said.items()}


def stale(root: Path) -> list[Recipe]:
    """Reports whose sources are not those that made them, or of which nothing is said."""
    said = stamps(root / "reports")
    return [r for r in RECIPES if r.name not in said or not is_fresh(r, said[r.name], root)]


def is_fresh(recipe: Recipe, stamp: Stamp, root: Path) -> bool:
    """Whether today's sources made a report, with its usual counts or its full ones."""
    return stamp.digest in (digest(recipe, root), digest(recipe.whole, root))


def stamped(reports: Path, recipe: Recipe, stamp: Stamp) -> None:
    """Write that a report was made."""
    said = stamps(reports) | {recipe.name: stamp}
    write_json(reports / FILE, {name: asdict(said[name]) for name in sorted(said)})


def _files(recipe: Recipe, root: Path) -> set[Path]:
    found: set[Path] = set()
    for source in recipe.sources:
        path = root / source
        found |= set(path.rglob("*.py")) if path.is_dir() else {path} if path.is_file() else set()
    return found


@cache
def _without_words(text: str) -> str:
    """Code without comments and docstrings, by its digest: recipes share most of their files."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, _BODIES):
            node.body = [line for line in node.body if not _is_text(line)]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def _is_text(node: ast.stmt) -> bool:
    match node:
        case ast.Expr(value=ast.Constant(value=str())):
            return True
    return False
