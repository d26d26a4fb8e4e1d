"""Read which code made each report (`reports/made.json`), and find the stale reports, whose code has changed since."""

import ast
import hashlib
import json
from functools import cache
from pathlib import Path

from validation.reports.recipes import RECIPES, Recipe

FILE = "made.json"
"""Name of the file in reports/ with the stamps of all reports. A stamp says which code made a report, and when."""


def digest(recipe: Recipe, root: Path) -> str:
    """Return the SHA-256 digest of everything that the numbers of a report depend on.

    These are its commands, the top-level statements of its Python files, and its other files byte by byte. The digest
    does not depend on comments, docstrings and imports, nor on which file contains a statement.

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
    code: list[str] = []
    for path in sorted(files):
        if path.suffix == ".py":
            code += _statements(path.read_text("utf-8"))
        else:
            total.update(f"\0{path.relative_to(root).as_posix()}\0".encode() + path.read_bytes())
    total.update("\0".join(sorted(code)).encode())
    return total.hexdigest()


def stamps(reports: Path) -> dict[str, dict[str, str]]:
    """Read the stamps of the reports in a folder, by the name of the report; return {} if there is no file of stamps.

    A stamp says how a report was made. It has the digest of its sources (`digest`), the commit of the code
    (`revision`), and the day (`day`, ISO 8601).
    """
    file = reports / FILE
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}


def stale(root: Path) -> list[Recipe]:
    """Return the recipes of stale reports: those without a stamp, or whose sources have changed since they were made.

    root: folder of the project.
    """
    stamp_of = stamps(root / "reports")
    return [r for r in RECIPES if stamp_of.get(r.name, {}).get("digest") != digest(r, root)]


@cache
def _statements(text: str) -> list[str]:
    """Return a text for each top-level statement of a Python source, which changes only if the statement changes.

    Imports, comments and docstrings are left out. The result is cached, because recipes share most files.
    """
    tree = ast.parse(text)
    for node in ast.walk(tree):
        for field, lines in ast.iter_fields(node):
            if field in ("body", "orelse", "finalbody") and isinstance(lines, list):
                setattr(node, field, [line for line in lines if _counts(line)])
    return [ast.dump(line) for line in tree.body]


def _counts(line: ast.stmt) -> bool:
    is_text = isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant)
    is_for_types = isinstance(line, ast.If) and ast.unparse(line.test) == "TYPE_CHECKING"
    return not (is_text or is_for_types or isinstance(line, ast.Import | ast.ImportFrom))
