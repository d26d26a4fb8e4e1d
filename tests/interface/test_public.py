"""The public names: each can be imported, and type checkers know the same names."""

import ast
from pathlib import Path

import bayesdamp as bd

SOURCE = Path(bd.__file__).read_text(encoding="utf-8")


def test_every_name_can_be_imported() -> None:
    assert all(getattr(bd, name) is not None for name in bd.__all__)
    assert set(dir(bd)) == set(bd.__all__) == {*bd._HOME, "__version__"}


def test_type_checkers_find_the_same_names_in_the_same_modules() -> None:
    blocks = (node for node in ast.walk(ast.parse(SOURCE)) if isinstance(node, ast.If))
    (block,) = (b for b in blocks if isinstance(b.test, ast.Name) and b.test.id == "TYPE_CHECKING")
    imported = {(a.asname or a.name): line.module for line in block.body for a in line.names}  # type: ignore[attr-defined]
    assert imported == bd._HOME
