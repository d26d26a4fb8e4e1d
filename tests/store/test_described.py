"""A run.json that no run wrote: one line that says where and what would be right, from whatever reads it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import bayesdamp as bd
from bayesdamp.cli import main
from bayesdamp.store.files import read_description
from bayesdamp.store.folders import MARK, SIGNED
from bayesdamp.types import InputError

SHIPPED = Path(__file__).resolve().parents[2] / "reports"
DEEP = "[" * 100_000
NO_RUN = {
    "": "cannot be read",
    '{"name": "rig", "stu': "cannot be read",
    DEEP: "cannot be read",
    "[]": "does not describe a run",
    "3": "does not describe a run",
    "null": "does not describe a run",
    '{"schema": 2}': "was written by another version of bayesdamp",
}
NO_QUESTION = [
    '{"asked": {"tables": {}}, "inputs": [1]}',
    '{"asked": {"tables": {}}, "study": 3}',
    '{"asked": {"tables": {}}, "study": {"plugins": 3}}',
    '{"asked": {"tables": {}}, "study": {"plugins": [{}]}}',
    DEEP,
]


def written(folder: Path, text: str) -> Path:
    folder.mkdir()
    (folder / "run.json").write_text(text, encoding="utf-8")
    (folder / MARK).write_text(SIGNED, encoding="utf-8")
    return folder


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert len(said.err) < 300
    return said.err


@pytest.mark.parametrize("text", NO_RUN, ids=lambda text: text[:60] or "nothing")
def test_what_reads_a_folder_refuses_what_is_no_run(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, page = written(tmp_path / "run", text), tmp_path / "claims.md"
    before = sorted(folder.iterdir())
    for words in (["report", "FOLDER"], ["claims", "--paper", "FOLDER"], ["claims", "--noise", "FOLDER"]):
        more = ["--out", str(page)] if words[0] == "claims" else []
        said = refused([str(folder) if word == "FOLDER" else word for word in words] + more, capsys)
        assert said.startswith(f"{folder / 'run.json'}: ")
        assert NO_RUN[text] in said
        assert "run the study again" in said
    with pytest.raises(InputError, match=r"run\.json: "):
        bd.Run.load(folder)
    assert sorted(folder.iterdir()) == before
    assert not page.exists()


@pytest.mark.parametrize("text", ["{}", '{"kind": "calibration"}', '{"name": "rig"}'])
def test_a_folder_that_names_no_study_is_no_run_of_one(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, page = written(tmp_path / "run", text), tmp_path / "claims.md"
    for option in ("--paper", "--noise"):
        said = refused(["claims", option, str(folder), "--out", str(page)], capsys)
        assert said.startswith(f"{option} {folder}: ")
        assert "give the folder of bayesdamp study" in said
    with pytest.raises(InputError, match="names no study; give the folder that run_study"):
        bd.Run.load(folder)
    assert not page.exists()


@pytest.mark.parametrize("text", NO_QUESTION, ids=lambda text: text[:60])
def test_what_asks_again_refuses_what_is_no_run(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "run", text) / "run.json"
    for words in (["check", str(path)], ["study", str(path), "--out", str(tmp_path / "out")]):
        assert "give " in refused(words, capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("path", sorted(SHIPPED.rglob("run.json")), ids=lambda path: path.parent.name)
def test_what_a_run_wrote_is_read(path: Path) -> None:
    """The negative control: runs of earlier versions among them."""
    assert read_description(path.parent) == json.loads(path.read_text(encoding="utf-8"))


def test_claims_judge_by_the_shipped_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The negative control of the commands."""
    page = tmp_path / "claims.md"
    words = [
        "claims",
        "--paper",
        str(SHIPPED / "paper"),
        "--noise",
        str(SHIPPED / "noise"),
        "--out",
        str(page),
    ]
    assert main(words) == 0, capsys.readouterr().err
    assert "Judged by the run `noise`" in page.read_text(encoding="utf-8")
