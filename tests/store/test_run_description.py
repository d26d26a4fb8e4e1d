"""A run.json that no run wrote is refused in one line by all that read it: where, and what would be right."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

import bayesdamp as bd
from bayesdamp.claims import paper
from bayesdamp.cli import main
from bayesdamp.store.files import SCHEMA, read_description
from bayesdamp.store.results import MARK_FILE, MARK_TEXT
from bayesdamp.types import InputError

SHIPPED = Path(__file__).resolve().parents[2] / "reports"
DEEP = "[" * 100_000
NO_RUN = {
    "": "cannot be read",
    '{"name": "rig", "stu': "cannot be read",
    DEEP: "cannot be read",
    "[]": "does not describe a run",
    '{"schema": 1}': "was written by another version of bayesdamp",
}
NO_STUDY = [
    "{",
    "{}",
    '{"asked": {"tables": {}}, "inputs": [1]}',
    '{"asked": {"tables": {}}, "study": {"plugins": 3}}',
    '{"asked": {"tables": {}}, "study": {"plugins": [{}]}}',
]


def written(folder: Path, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "run.json").write_text(text, encoding="utf-8")
    (folder / MARK_FILE).write_text(MARK_TEXT, encoding="utf-8")
    return folder


@pytest.mark.parametrize(("text", "why"), NO_RUN.items(), ids=lambda text: text[:20])
def test_commands_refuse_another_description(tmp_path: Path, refused, text: str, why: str) -> None:
    folder, page = written(tmp_path / "run", text), tmp_path / "claims.md"
    before = sorted(folder.iterdir())
    for words in (("report", str(folder)), ("claims", "--paper", str(folder), "--out", str(page))):
        line = refused(*words)
        assert line.startswith(f"{folder / 'run.json'}: ")
        assert why in line
        assert "run the study again" in line
    with pytest.raises(InputError, match=r"run\.json: "):
        bd.Run.load(folder)
    assert sorted(folder.iterdir()) == before
    assert not page.exists()


def test_commands_that_need_a_study_refuse_a_run_of_another_command(
    tmp_path: Path, refused: Callable[..., str]
) -> None:
    page = tmp_path / "claims.md"
    for text in ("{}", f'{{"kind": "calibration", "schema": {SCHEMA}}}', '{"name": "rig"}'):
        folder = written(tmp_path / "run", text)
        for option in ("--paper", "--noise"):
            line = refused("claims", option, str(folder), "--out", str(page))
            assert line.startswith(f"{option} {folder}: ")
            assert "give the folder of bayesdamp study" in line
        with pytest.raises(InputError, match="does not contain a study; give the folder that run_study"):
            bd.Run.load(folder)
        assert not page.exists()


@pytest.mark.parametrize("text", NO_STUDY, ids=lambda text: text[:50])
def test_commands_that_repeat_a_study_refuse_another_description(tmp_path: Path, refused, text: str) -> None:
    path = written(tmp_path / "run", text) / "run.json"
    for words in (("check", str(path)), ("study", str(path), "--out", str(tmp_path / "out"))):
        assert "give " in refused(*words)
    assert not (tmp_path / "out").exists()


def test_shipped_descriptions_are_read() -> None:
    """The negative control."""
    paths = sorted(SHIPPED.rglob("run.json"))
    assert paths
    for path in paths:
        assert read_description(path.parent) == json.loads(path.read_text(encoding="utf-8"))


def test_claims_are_judged_by_the_shipped_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The negative control of the commands. Claims that need no run (of section 4.5) take seconds to measure."""
    judged_by_runs = [claim for claim in paper.CLAIMS if claim.where != "4.5"]
    monkeypatch.setattr("bayesdamp.cli.commands.claims.CLAIMS", judged_by_runs)
    page = tmp_path / "claims.md"
    runs = ["--paper", str(SHIPPED / "paper"), "--noise", str(SHIPPED / "noise")]
    assert main(["claims", *runs, "--out", str(page)]) == 0, capsys.readouterr().err
    assert "Judged by the run `noise`" in page.read_text(encoding="utf-8")
