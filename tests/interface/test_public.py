"""The public names: all there, all typed, none loaded before it is used."""

from __future__ import annotations

import ast
from pathlib import Path

import bayesdamp as bd

SOURCE = Path(bd.__file__).read_text(encoding="utf-8")


def for_type_checkers() -> dict[str, str]:
    """Name to module, as the block for type checkers imports them."""
    found: dict[str, str] = {}
    for node in ast.walk(ast.parse(SOURCE)):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            for line in node.body:
                assert isinstance(line, ast.ImportFrom)
                found |= {(a.asname or a.name): str(line.module) for a in line.names}
    return found


def test_every_name_is_there() -> None:
    for name in bd.__all__:
        assert getattr(bd, name) is not None
    assert set(dir(bd)) == set(bd.__all__)


def test_type_checkers_see_the_same_names_in_the_same_places() -> None:
    assert for_type_checkers() == bd._HOME
    assert set(bd.__all__) == {*bd._HOME, "__version__"}
