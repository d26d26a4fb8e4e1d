"""What a user reads is in the terms of the field, without the words that this program once used for them."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "bayesdamp"

OWN = re.compile(
    r"equivalent ratio|keeps? step|in step with|nats behind|(?<!mean that is )\bset(s|ting)? aside|\bclimb"
    r"|seed leads|\bseeds that\b|from seeds|\breferee|\bcells? (failed|under way)|(longest|some|its) cells"
    r"|\bcandidate(s|\b)(?! (terms|records))|energy lost a cycle|window spread|what to believe"
    r"|\brefined (estimate|one|figure|value)",
    re.IGNORECASE,
)
"""Words of ours for which the field has other terms."""
CODE = re.compile(r"```.*?```|`[^`]*`|\(\w+\.md\)", re.DOTALL)
"""What a user types is not checked: keys of studies and tables."""
EXEMPT = ("bayesdamp/claims/", "bayesdamp/calibrate/tables.py")
"""Modules with texts that ship in `reports/`, and with a key of tables."""


def own_words(text: str) -> list[str]:
    """Return the words of ours in a text, without those in code."""
    return [match.group() for match in OWN.finditer(CODE.sub("", text))]


def shown_text(path: Path) -> str:
    """Return what a user reads of a file: the texts in a module without docstrings, or a whole page or template."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return text
    tree = ast.parse(text)
    is_help = path.parent.name == "commands"  # whose docstrings are shown
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr) and not is_help}
    strings = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and id(n) not in docstrings]
    return "\n".join(s for s in strings if isinstance(s, str) and " " in s.strip())


def test_what_a_user_reads_is_in_the_terms_of_the_field() -> None:
    patterns = ("*.md", "howto/*.md", "notebooks/*.ipynb")
    docs = [path for pattern in patterns for path in (ROOT / "docs").glob(pattern)]
    paths = [ROOT / "README.md", *docs, *PACKAGE.rglob("*.py"), *PACKAGE.glob("report/templates/*.html")]
    shown = [path for path in paths if not path.relative_to(ROOT).as_posix().startswith(EXEMPT)]
    assert len(shown) > 100
    assert {path: words for path in shown if (words := own_words(shown_text(path)))} == {}


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("the next is 12 nats behind the best", 1),
        ("no candidate fits; 3 cells failed: a/b", 2),
        ("Refined values agree, and the refined estimate is best", 2),
        ("`combined` and `referee` are keys, `refined estimate` is a method", 0),
        ("2 rows with an empty cell left out; candidate terms of a library; the seed of the noise", 0),
    ],
)
def test_own_words_are_recognised_and_similar_ones_are_not(text: str, count: int) -> None:
    assert len(own_words(text)) == count
