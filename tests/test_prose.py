"""Decisions are values: no file takes a name, a label or a sentence apart that another one made."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "bayesdamp"

TAKEN_APART = {
    "startswith", "endswith", "split", "rsplit", "partition", "rpartition", "removeprefix", "removesuffix",
}  # fmt: skip
MADE = {
    "name", "label", "seed", "outcome", "sentence", "message", "diagnostic", "verdict", "title", "caption", "words",
    "remark", "note", "why", "what", "reason", "axis",
}  # fmt: skip
"""Attributes, and values by these keys, that are written for people, or to tell things apart."""
VARIABLES = MADE - {"name", "title", "words", "what"}
"""Variables that hold such."""
MAY: dict[str, str] = {
    "records/": "a file's columns are named by its user",
    "plugins.py": "modules and entry points have dotted names",
    "outcomes.py": "the one place that writes and reads how tables say an outcome",
    "store/places.py": "the one place that reads what a task is about from its name",
}
"""Where names come from outside and are read, or the one place that reads what it wrote."""


def read_as_prose(source: str) -> Iterator[str]:
    """Each place of a module that takes an attribute of these names apart, or the text of an error."""
    tree = ast.parse(source)
    errors = {n.name for n in ast.walk(tree) if isinstance(n, ast.ExceptHandler) and n.name}

    def made(node: ast.expr) -> bool:
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id == "str"
            and node.args
        ):
            inner = node.args[0]
            return made(inner) or (isinstance(inner, ast.Name) and inner.id in errors)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):  # `x.label.strip()`
            return made(node.func.value)
        if isinstance(node, ast.Subscript):
            key = node.slice
            return made(node.value) or (isinstance(key, ast.Constant) and key.value in MADE)
        named = isinstance(node, ast.Name) and node.id in VARIABLES
        return named or (isinstance(node, ast.Attribute) and node.attr in MADE)

    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:  # not at blanks
            read = node.func.attr in TAKEN_APART and made(node.func.value)
        elif isinstance(node, ast.Compare) and isinstance(node.left, ast.Constant | ast.JoinedStr):
            inside = any(isinstance(o, ast.In | ast.NotIn) for o in node.ops)
            read = inside and any(made(side) for side in node.comparators)
        else:
            read = False
        if read:
            yield f"line {node.lineno}: {ast.unparse(node)}"


def test_no_file_takes_apart_what_another_wrote_for_people() -> None:
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        inside = path.relative_to(PACKAGE).as_posix()
        if not inside.startswith(tuple(MAY)):
            found += [f"{inside}, {one}" for one in read_as_prose(path.read_text(encoding="utf-8"))]
    assert not found, "\n".join(found)


def test_what_is_taken_apart_is_seen() -> None:
    """The negative control: each form that was mended is found, and what is none is not."""
    cases = [
        ("kind = cell.name.split('/')[4]", 1),
        ("try:\n    f()\nexcept InputError as error:\n    text = str(error).removeprefix('x: ')", 1),
        ("if 'agree' in verdict.sentence: pass", 1),
        ("unit = axis.rpartition('/ ')[2]", 1),
        ("if row['outcome'].startswith('fits'): pass", 1),
        ("kind = cell.place.kind", 0),
        ("terms = v.damping.split('+')", 0),
        ("line = ' '.join(str(text).split())", 0),
        ("if column.name in names: pass", 0),
    ]
    for source, count in cases:
        assert len(list(read_as_prose(source))) == count
