"""Each case of bad input: exit status 2, one short line, no traceback, no new files."""

import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from bayesdamp.cli import main
from bayesdamp.records.files import contents
from tests.bad_input import binaries, commands, studies, tables
from tests.bad_input.case import READ, REFUSED, Case
from tests.bad_input.judge import judge

OK = (READ,)
CASES = [*tables.CASES, *binaries.CASES, *studies.CASES, *commands.CASES]
CONTROLS = [
    *(Case(form, ("look", "FILE"), f"a.{form}", write, "", OK) for form, write in binaries.FORMATS.items()),
    Case("study", ("check", "FILE"), "a.toml", studies.control, "", OK),
    Case("table", tables.LOOK, "a.csv", tables.rows, "", OK),
]
"""The same files and studies without their faults."""


@pytest.mark.parametrize("cases", [*(CASES[i : i + 40] for i in range(0, len(CASES), 40)), CONTROLS])
def test_bad_input_is_refused_in_one_line(cases: Sequence[Case], monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test has forty cases and lists all that fail."""
    monkeypatch.setattr(contents, "LARGEST_FILE", 2**26)
    failures = []
    for case in cases:
        try:
            judge(case.arguments, case.file, case.write, statuses=case.statuses, line=case.line)
        except AssertionError as failure:
            failures.append(f"{case.name}: {failure}")
    assert not failures, "\n".join(failures)


@pytest.mark.parametrize("command", ["look", "check"])
def test_a_file_without_permission_is_refused(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Root may read every file, so that the command then runs as another user."""
    tmp_path.chmod(0o777)
    root = os.geteuid() == 0
    path = tmp_path / "a.csv"
    path.write_bytes(b"1,2\n")
    path.chmod(0)
    for above in (p for p in tmp_path.parents if root and p.owner() == "root" and p != Path("/")):
        above.chmod(above.stat().st_mode | 0o011)
    if root:
        os.seteuid(65534)
    try:
        status = main([command, str(path)])
    finally:
        if root:
            os.seteuid(0)
    error = capsys.readouterr().err
    assert status == REFUSED
    assert "cannot be read" in error
    assert "permission denied" in error.lower()
