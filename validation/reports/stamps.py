"""Record which code made each report in `reports/made.json`, and find out which reports are stale."""

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


@dataclass(frozen=True)
class Stamp:
    """The origin of a report: digest of its sources, commit that made it (revision), and day (ISO 8601)."""

    digest: str
    revision: str
    day: str


def digest(recipe: Recipe, root: Path) -> str:
    """Return the SHA-256 digest of everything that the numbers of a report depend on.

    These are its commands, its source files without comments and docstrings (the order of imports does not matter), and
    its other files byte by byte.

    Parameters
    ----------
    recipe : Recipe
        The report.
    root : Path
        The project folder with the sources.
    """
    total = hashlib.sha256("\0".join(recipe.commands).encode())
    for path in sorted(_files(recipe, root)):
        total.update(f"\0{path.relative_to(root).as_posix()}\0".encode())
        is_code = path.suffix == ".py"
        total.update(_without_words(path.read_text("utf-8")).encode() if is_code else path.read_bytes())
    return total.hexdigest()


def stamps(reports: Path) -> dict[str, Stamp]:
    """Read the stamps of the reports in a folder; return none if there is no file."""
    file = reports / FILE
    if not file.is_file():
        return {}
    content: Mapping[str, Mapping[str, str]] = json.loads(file.read_text(encoding="utf-8"))
    return {name: Stamp(**stamp) for name, stamp in content.items()}


def stale(root: Path) -> list[Recipe]:
    """Return the reports without a stamp, and those whose sources have changed since."""
    stamp_of = stamps(root / "reports")
    return [r for r in RECIPES if r.name not in stamp_of or not is_fresh(r, stamp_of[r.name], root)]


def is_fresh(recipe: Recipe, stamp: Stamp, root: Path) -> bool:
    """Return whether the current sources made a report, with its usual or its full number of records."""
    return stamp.digest in (digest(recipe, root), digest(recipe.whole, root))


def write_stamp(reports: Path, recipe: Recipe, stamp: Stamp) -> None:
    """Write the stamp of a report."""
    stamp_of = stamps(reports) | {recipe.name: stamp}
    write_json(reports / FILE, {name: asdict(stamp_of[name]) for name in sorted(stamp_of)})


def _files(recipe: Recipe, root: Path) -> set[Path]:
    files: set[Path] = set()
    for source in recipe.sources:
        path = root / source
        files |= set(path.rglob("*.py")) if path.is_dir() else {path} if path.is_file() else set()
    return files


@cache
def _without_words(text: str) -> str:
    """Return the digest of code without comments and docstrings. It is cached because recipes share most files.

    It does not depend on where in the file an import stands, only on what is imported.
    """
    tree = ast.parse(text)
    imported: set[tuple[str, str, str]] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            module = f"{node.level}:{node.module}" if isinstance(node, ast.ImportFrom) else ""
            imported |= {(module, n.name, n.asname or "") for n in node.names if module != "0:typing"}
    for node in ast.walk(tree):
        for name in ("body", "orelse", "finalbody"):
            lines = getattr(node, name, None)
            if isinstance(lines, list):
                setattr(node, name, [line for line in lines if not (_is_text(line) or _is_import(line))])
    return hashlib.sha256(f"{sorted(imported)}{ast.dump(tree)}".encode()).hexdigest()


def _is_import(node: ast.stmt) -> bool:
    match node:
        case ast.Import() | ast.ImportFrom() | ast.If(test=ast.Name(id="TYPE_CHECKING")):
            return True
    return False


def _is_text(node: ast.stmt) -> bool:
    match node:
        case ast.Expr(value=ast.Constant(value=str())):
            return True
    return False
