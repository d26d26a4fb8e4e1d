"""`bayesdamp doctor`."""

import os
from pathlib import Path
from unittest.mock import Mock

import pytest

from bayesdamp.cli import main
from bayesdamp.cli.commands import doctor
from bayesdamp.types import InputError


def test_an_exception_in_a_check_is_its_result(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = Mock(side_effect=OSError("no such library"), __name__="broken")
    monkeypatch.setattr(doctor, "CHECKS", (doctor.machine, broken))
    assert main(["doctor"]) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("ok  machine")
    assert second == "NO  broken     OSError: no such library"


def test_a_cache_that_cannot_be_written_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv("BAYESDAMP_CACHE", str(tmp_path / "file" / "below"))
    with pytest.raises(InputError, match="BAYESDAMP_CACHE"):
        doctor.cache()
    monkeypatch.setenv("BAYESDAMP_CACHE", str(tmp_path / "new"))
    assert "can be written" in doctor.cache()


@pytest.mark.slow
def test_all_checks_pass_on_this_machine(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(doctor.CHECKS)
    assert all(line.startswith("ok  ") for line in lines)


def test_memory_is_not_checked_where_the_system_does_not_state_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sysconf")
    assert "memory" not in doctor.machine()
