"""`bayesdamp doctor` and `bayesdamp completion`."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bayesdamp.cli import main
from bayesdamp.cli.commands import doctor
from bayesdamp.cli.commands.completion import SHELLS, VARIABLE


def test_an_exception_in_a_check_is_its_result(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken() -> doctor.CheckResult:
        raise OSError("no such library")

    monkeypatch.setattr(doctor, "CHECKS", (doctor.machine, broken))
    assert main(["doctor"]) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("ok  machine")
    assert second == "NO  broken     OSError: no such library"


def test_versions_out_of_range_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.packages().good
    monkeypatch.setattr(doctor, "requires", lambda _: ["numpy>=2.0", "scipy>=99", "no-such-library>=1"])
    result = doctor.packages()
    assert not result.good
    assert re.search("scipy is .* but >=99", result.text)
    assert "no-such-library is missing" in result.text


def test_a_cache_that_cannot_be_written_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv("BAYESDAMP_CACHE", str(tmp_path / "file" / "below"))
    result = doctor.cache()
    assert not result.good
    assert "BAYESDAMP_CACHE" in result.text
    monkeypatch.setenv("BAYESDAMP_CACHE", str(tmp_path / "new"))
    assert doctor.cache().good


@pytest.mark.slow
def test_all_checks_pass_on_this_machine(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(doctor.CHECKS)
    assert all(line.startswith("ok  ") for line in lines)


def test_completion_scripts_are_valid_in_their_shells(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "script"
    for shell in SHELLS:
        assert main(["completion", shell]) == 0
        text = capsys.readouterr().out
        assert VARIABLE in text
        if shutil.which(shell):
            path.write_text(text, encoding="utf-8")
            assert subprocess.run([shell, "-n", path], check=False).returncode == 0
    assert main(["completion", "tcsh"]) == 2
    assert capsys.readouterr().err == "completion tcsh: unknown shell; valid are bash, zsh, fish\n"


@pytest.mark.parametrize(
    ("words", "options"),
    [("compare --qu", {"--quantity", "--quick", "--quiet"}), ("comparr --qu", set())],
)
def test_a_shell_completes_options(words: str, options: set[str]) -> None:
    code = "import sys; sys.argv[0] = 'bayesdamp'; from bayesdamp.cli import main; sys.exit(main())"
    request = {"COMP_WORDS": f"bayesdamp {words}", "COMP_CWORD": "2", VARIABLE: "complete_bash"}
    command = [sys.executable, "-c", code]
    process = subprocess.run(command, env=os.environ | request, capture_output=True, text=True)
    assert (set(process.stdout.split()), process.stderr) == (options, "")


def test_memory_is_not_checked_where_the_system_does_not_state_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sysconf")
    result = doctor.machine()
    assert result.good
    assert "memory" not in result.text
