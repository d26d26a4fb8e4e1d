"""Every command's help has an example that its own options would take, and no option stands outside a group."""

from __future__ import annotations

import shlex

import pytest
import typer

from bayesdamp.cli import main
from bayesdamp.cli.app import app

COMMANDS = {name: command for name, command in typer.main.get_command(app).commands.items()}  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_help_has_an_example(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "-h"]) == 0
    assert "Example: bayesdamp" in " ".join(capsys.readouterr().out.split())
    example = COMMANDS[name].epilog.removeprefix("Example: bayesdamp ").split(" > ")[0]
    words = shlex.split(example)
    assert words[0] == name
    known = {option for p in COMMANDS[name].params for option in p.opts}
    assert {word for word in words if word.startswith("--")} <= known
    assert COMMANDS[name].make_context(
        name, words[1:], resilient_parsing=False
    )  # raises on what it does not know


@pytest.mark.parametrize("name", ["compare", "look", "init", "study"])
def test_options_stand_in_groups(name: str) -> None:
    options = [p for p in COMMANDS[name].params if p.param_type_name == "option" and p.name != "help"]
    loose = [p.name for p in options if getattr(p, "rich_help_panel", None) is None]
    assert set(loose) <= {"html"}
