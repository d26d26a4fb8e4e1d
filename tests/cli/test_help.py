"""The help of every command has a valid example, and groups its options."""

import shlex

import pytest

from bayesdamp.cli import main
from bayesdamp.cli.app import COMMANDS, command

LOADED = {name: command(name) for name in COMMANDS}


@pytest.mark.parametrize("name", LOADED)
def test_help_has_an_example(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    loaded = LOADED[name]
    assert loaded.help.splitlines()[0] == COMMANDS[name][0], "in the list of all commands"
    assert main([name, "-h"]) == 0
    assert "Example: bayesdamp" in " ".join(capsys.readouterr().out.split())
    words = shlex.split(loaded.epilog.removeprefix("Example: bayesdamp ").split(" > ")[0])
    assert words[0] == name
    assert loaded.make_context(name, words[1:])  # raises on what it does not know


def test_options_are_in_groups() -> None:
    for name in ("compare", "look", "init", "study"):
        options = [p for p in LOADED[name].params if p.param_type_name == "option" and p.name != "help"]
        assert {p.name for p in options if getattr(p, "rich_help_panel", None) is None} <= {"html"}, name
