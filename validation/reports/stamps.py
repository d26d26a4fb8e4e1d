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
    files: set[Path] = set()
    for path in (root / source for source in recipe.sources):
        files |= set(path.rglob("*.py")) if path.is_dir() else {path} if path.is_file() else set()
    for path in sorted(files):
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
    """Return whether the report with this stamp was made from the current sources, by its usual or full commands."""
    return stamp.digest in (digest(recipe, root), digest(recipe.whole, root))


def write_stamp(reports: Path, recipe: Recipe, stamp: Stamp) -> None:
    """Write the stamp of a report into `reports/made.json`; the stamps of other reports stay unchanged."""
    stamp_of = stamps(reports) | {recipe.name: stamp}
    write_json(reports / FILE, {name: asdict(stamp_of[name]) for name in sorted(stamp_of)})


class _Code(ast.NodeTransformer):
    """Removes docstrings and imports from a syntax tree, and collects in `imported` what the code imports."""

    def __init__(self) -> None:
        self.imported: set[tuple[str, str, str]] = set()

    def visit_Import(self, node: ast.Import | ast.ImportFrom) -> None:
        module = f"{node.level}:{node.module}" if isinstance(node, ast.ImportFrom) else ""
        self.imported |= {(module, n.name, n.asname or "") for n in node.names if module != "0:typing"}

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        self.visit_Import(node)

    def visit_If(self, node: ast.If) -> ast.AST | None:
        self.generic_visit(node)
        return None if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING" else node

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if is_text else self.generic_visit(node)


@cache
def _without_words(text: str) -> str:
    """Return the SHA-256 of the code in a source text, without comments and docstrings.

    Results are cached because recipes share most files. The digest does not depend on where in the file an import
    stands, only on what is imported.
    """
    code = _Code()
    tree = code.visit(ast.parse(text))
    return hashlib.sha256(f"{sorted(code.imported)}{ast.dump(tree)}".encode()).hexdigest()
