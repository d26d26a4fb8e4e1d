"""A comparison of envelopes that was interrupted is completed, with the same files."""

from __future__ import annotations

from pathlib import Path

import pytest

from bayesdamp.cli import main
from bayesdamp.interface import envelopes
from tests.envelope.test_command import written

FILES = ("verdict.json", "verdicts.csv", "report.html", "figures/answer-r1.png")


@pytest.fixture
def answered(monkeypatch) -> list[str]:
    """Return a list to which the name of each record is added when it is computed."""
    names: list[str] = []
    analyse = envelopes.analyse

    def counted(record, *rest):
        names.append(record.name)
        return analyse(record, *rest)

    monkeypatch.setattr(envelopes, "analyse", counted)
    return names


def command(folder: Path) -> list[str]:
    records = [str(folder / f"r{k}.txt") for k in (1, 2, 3)]
    return ["compare", *records, "--workers", "1", "--out", str(folder / "out")]


def contents(out: Path) -> dict[str, bytes]:
    """Return the files of a run; of the report only what is above the durations of its tasks."""
    return {name: (out / name).read_bytes().split(b'<section id="provenance"')[0] for name in FILES}


def test_an_interrupted_comparison_computes_only_what_is_missing(tmp_path, capsys, answered):
    for k in (1, 2, 3):
        written(tmp_path / f"r{k}.txt", k)
    assert main(command(tmp_path)) == 0
    assert answered == ["r1", "r2", "r3"]
    whole, text = contents(tmp_path / "out"), capsys.readouterr().out

    # as after a kill: one answer complete, one incomplete, one missing, no tables
    out = tmp_path / "out"
    cells = sorted((out / "cells").rglob("*.npz"))
    cells[1].write_bytes(cells[1].read_bytes()[:-100])
    cells[2].unlink()
    for name in ("verdict.json", "verdicts.csv", "report.html", "run.json"):
        (out / name).unlink()
    answered.clear()
    assert main(command(tmp_path)) == 0
    assert answered == ["r2", "r3"]
    assert contents(out) == whole
    assert capsys.readouterr().out == text

    # Negative control: what depends on a changed file is computed, once.
    written(tmp_path / "r2.txt", 5)
    for again in (["r2"], []):
        answered.clear()
        assert main(command(tmp_path)) == 0
        assert answered == again
