"""What a user reads is in the words of the field: none of those that once stood for them in this program."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "bayesdamp"

INSTEAD = {
    r"equivalent ratio": "equivalent viscous damping ratio",
    r"keeps? step|in step with": "stays in phase",
    r"nats behind": "log Bayes factor",
    r"(?<!mean that is )\bset(s|ting)? aside": "pruned",
    r"\bclimb": "optimisation",
    r"seed leads|\bseeds that\b|from seeds": "starting point",
    r"\breferee": "nested-sampling check",
    r"\bcells? (failed|under way)|(longest|some|its) cells": "task",
    r"\bcandidate(s|\b)(?! (terms|records))": "damping model",
    r"energy lost a cycle": "specific damping capacity",
    r"window spread": "stability over sub-records",
    r"what to believe": "conclusions and caveats",
    r"\brefined (estimate|one|figure|value)": "trajectory fit",
}
"""Words of ours, as patterns, and the field's."""
OWN = re.compile("|".join(f"(?:{pattern})" for pattern in INSTEAD), re.IGNORECASE)
CODE = re.compile(r"```.*?```|`[^`]*`|\(\w+\.md\)", re.DOTALL)
"""What is typed stays as it is: keys of studies and tables."""
MAY = ("claims/", "calibrate/tables.py")
"""What ships in `reports/`, and a key of tables."""


def own_words(text: str) -> list[str]:
    """The words of ours in a text, without what is typed."""
    return [found.group() for found in OWN.finditer(CODE.sub("", text))]


def said(source: str, docstrings: bool = False) -> Iterator[tuple[int, str]]:
    """Lines and texts of a module that are prose: strings with a blank in them, docstrings where these are help."""
    tree = ast.parse(source)
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
        if " " in text.strip() and (docstrings or id(node) not in alone):
            yield node.lineno, text


def test_the_program_speaks_the_words_of_the_field() -> None:
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        inside = path.relative_to(PACKAGE).as_posix()
        if inside.startswith(MAY):
            continue
        for line, text in said(path.read_text(encoding="utf-8"), inside.startswith("cli/commands/")):
            found += [f"{inside}:{line}: {word}" for word in own_words(text)]
    for path in sorted((PACKAGE / "report" / "templates").glob("*.html")):
        markup = re.sub(r"\{[{%].*?[%}]\}", "", path.read_text(encoding="utf-8"))
        found += [f"{path.name}: {word}" for word in own_words(markup)]
    assert not found, "\n".join(found)


def pages() -> list[Path]:
    """The README, the pages of the site and its notebooks."""
    docs = ROOT / "docs"
    made = {docs / "_build", docs / "_generated"}
    found = [*docs.glob("**/*.md"), *docs.glob("**/*.ipynb")]
    return [ROOT / "README.md", *sorted(path for path in found if not made & set(path.parents))]


def test_the_pages_do_too() -> None:
    for path in pages():
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".ipynb":
            cells = (cell["source"] for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown")
            text = "".join("".join(lines) for lines in cells)
        assert not own_words(text), path


def test_own_words_are_seen() -> None:
    """The negative control: each is found, and what only looks alike is not."""
    cases = [
        ("the next is 12 nats behind the best", 1),
        ("no candidate fits; 3 cells failed: a/b", 2),
        ("Refined values agree, and the refined estimate is best", 2),
        ("`combined` and `referee` are keys, `refined estimate` is a method", 0),
        ("2 rows with an empty cell left out; candidate terms of a library; the seed of the noise", 0),
    ]
    for text, count in cases:
        assert len(own_words(text)) == count
