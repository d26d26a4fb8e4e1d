"""What a user reads is in the words of the field: none of those that once stood for them in this program."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "bayesdamp"

OWN = re.compile(
    r"equivalent ratio|keeps? step|in step with|nats behind|(?<!mean that is )\bset(s|ting)? aside|\bclimb"
    r"|seed leads|\bseeds that\b|from seeds|\breferee|\bcells? (failed|under way)|(longest|some|its) cells"
    r"|\bcandidate(s|\b)(?! (terms|records))|energy lost a cycle|window spread|what to believe"
    r"|\brefined (estimate|one|figure|value)",
    re.IGNORECASE,
)
"""Words of ours, for which the field has others."""
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


def shown_texts() -> Iterator[tuple[str, str]]:
    """Yield place and text of all that a user reads: of the program, its templates, README, pages and notebooks."""
    for path in sorted(PACKAGE.rglob("*.py")):
        inside = path.relative_to(PACKAGE).as_posix()
        if not inside.startswith(MAY):
            for line, text in said(path.read_text(encoding="utf-8"), inside.startswith("cli/commands/")):
                yield f"{inside}:{line}", text
    for path in sorted((PACKAGE / "report" / "templates").glob("*.html")):
        yield path.name, re.sub(r"\{[{%].*?[%}]\}", "", path.read_text(encoding="utf-8"))
    docs = ROOT / "docs"
    for path in [ROOT / "README.md", *docs.glob("**/*.md"), *docs.glob("**/*.ipynb")]:
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".ipynb":
            cells = (cell["source"] for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown")
            text = "".join("".join(lines) for lines in cells)
        if not {docs / "_build", docs / "_generated"} & set(path.parents):
            yield path.name, text


def test_what_a_user_reads_is_in_the_words_of_the_field() -> None:
    texts = list(shown_texts())
    assert len(texts) > 100
    found = [f"{place}: {word}" for place, text in texts for word in own_words(text)]
    assert not found, "\n".join(found)


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
