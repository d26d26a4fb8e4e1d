"""What a user writes: short scripts, run as they are."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

from bayesdamp.physics.damping import TERMS

SCRIPTS = Path(__file__).with_name("scripts")
NAMES = sorted(p.stem for p in SCRIPTS.glob("*.py"))
SAID = {
    "estimator": "by koopman",
    "evidence": "times as likely",
    "leave_one_out": "elpd_loo",
    "one_fit": "zeta = 0.0",
    "other_sampler": "'zeta': ",
    "own_term": "drag3",
    "posterior": "half_life",
    "several_records": "run 2",
    "study": "log_evidence",
}
WRITTEN = {
    "posterior": "traces.png",
    "predict": "ahead.png",
    "saving": "viscous.nc",
    "study": "small/report.html",
}


SLOW = ("own_prior", "study")


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in NAMES])
def test_it_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    mpl.use("agg")
    try:
        runpy.run_path(str(SCRIPTS / f"{name}.py"), run_name="__main__")
    finally:
        plt.close("all")
        TERMS.remove("cubic_drag")
    assert SAID.get(name, "") in capsys.readouterr().out
    assert name not in WRITTEN or (tmp_path / WRITTEN[name]).is_file()


def strict(*arguments: str) -> subprocess.CompletedProcess[str]:
    pyright = Path(sys.executable).with_name("pyright")
    return subprocess.run([str(pyright), *arguments], capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_their_types_are_strictly_right() -> None:
    found = strict("-p", str(SCRIPTS))
    assert found.returncode == 0, found.stdout


@pytest.mark.slow
def test_a_wrong_type_is_seen(tmp_path: Path) -> None:
    """The negative control: a model in the place of a signal, and an attribute that is none."""
    config = (SCRIPTS / "pyrightconfig.json").read_text(encoding="utf-8")
    root = str(SCRIPTS.parents[2])
    (tmp_path / "pyrightconfig.json").write_text(config.replace("../../..", root), encoding="utf-8")
    wrong = 'import bayesdamp as bd\n\nprint(bd.fit(bd.Model("viscous"), bd.Model("viscous")).value)\n'
    (tmp_path / "wrong.py").write_text(wrong, encoding="utf-8")
    found = strict("-p", str(tmp_path))
    assert found.returncode == 1
    assert "reportArgumentType" in found.stdout
    assert "reportAttributeAccessIssue" in found.stdout


PAGE = Path(__file__).resolve().parents[2] / "docs" / "python.md"


def examples(text: str) -> str:
    """The Python of a page, in its order, on the page's own lines."""
    kept, inside = [], False
    for line in text.splitlines():
        if line.startswith("```"):
            inside = line == "```python"
            line = ""
        kept.append(line if inside else "")
    return "\n".join(kept)


@pytest.mark.slow
def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mpl.use("agg")
    try:
        exec(compile(examples(PAGE.read_text(encoding="utf-8")), str(PAGE), "exec"), {"__name__": "page"})
    finally:
        plt.close("all")
        TERMS.remove("cubic_drag")
    assert (tmp_path / "viscous.nc").is_file()
