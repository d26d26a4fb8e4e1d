"""Each case of bad input: exit 2, one line that is short, no traceback, nothing left behind."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from bayesdamp.cli import main
from bayesdamp.records.files import limits
from tests.bad_input import binaries, commands, studies, tables
from tests.bad_input.case import READ, REFUSED, Case

LONGEST = 300
PATIENCE = 20
"""Seconds within which a case ends."""
LEAST = 400
"""Cases that the corpus holds at least."""
CORPUS = {c.name: c for m in (tables, binaries, studies, commands) for c in m.CASES}


@pytest.fixture(autouse=True)
def _small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(limits, "LARGEST", 2**26)
    before = signal.signal(signal.SIGALRM, _late)
    signal.alarm(PATIENCE)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def _late(*_: object) -> None:
    raise TimeoutError(f"it has not ended after {PATIENCE} s")


def tree(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def judge(case: Case, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Run a case, and say what is not as it should be."""
    path = folder / case.file
    case.write(path)
    before = tree(folder)
    capsys.readouterr()
    status = main([str(path) if a == "FILE" else a.replace("FILE/", f"{path}/") for a in case.arguments])
    said = capsys.readouterr().err
    assert status in case.ends, said
    assert "Traceback" not in said
    assert tree(folder) == before, "left something behind"
    if status == REFUSED:
        lines = said.splitlines()
        assert len(lines) == 1, said
        assert 20 < len(lines[0]) < LONGEST, f"{len(lines[0])} characters: {said[:400]}"
        assert lines[0].isprintable(), repr(said)
        assert case.said in said


@pytest.mark.parametrize("name", CORPUS)
def test_a_case_of_the_corpus(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    judge(CORPUS[name], tmp_path, capsys)


def test_the_corpus_is_large_and_its_names_are_distinct() -> None:
    assert len(CORPUS) >= LEAST
    assert len(CORPUS) == sum(len(m.CASES) for m in (tables, binaries, studies, commands))


@pytest.mark.parametrize("form", binaries.FORMATS)
def test_the_undamaged_files_are_read(form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The negative control: what the damaged files were before."""
    judge(Case(form, ("look", "FILE"), f"a.{form}", binaries.FORMATS[form], ends=(READ,)), tmp_path, capsys)


def test_the_faultless_table_and_study_are_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    judge(Case("study", ("check", "FILE"), "a.toml", studies.control, ends=(READ,)), tmp_path, capsys)
    judge(Case("table", tables.LOOK, "a.csv", tables.rows, ends=(READ,)), tmp_path, capsys)


@pytest.mark.parametrize("case", commands.UNREADABLE, ids=lambda c: c.name)
def test_a_file_that_may_not_be_read(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As another user where the tests run as one who may read everything."""
    tmp_path.chmod(0o777)
    root = os.geteuid() == 0
    path = tmp_path / case.file
    commands.shut(path)
    for above in (p for p in tmp_path.parents if root and p.owner() == "root" and p != Path("/")):
        above.chmod(above.stat().st_mode | 0o011)
    if root:
        os.seteuid(65534)
    try:
        status = main([case.arguments[0], str(path)])
    finally:
        if root:
            os.seteuid(0)
    said = capsys.readouterr().err
    assert status == REFUSED
    assert "cannot be read" in said
    assert "permission denied" in said.lower()
