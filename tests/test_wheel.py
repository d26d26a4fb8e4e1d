"""The wheel has what the program needs: its studies, templates and types, and neither tests nor validation."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, source / name)
    left_out = shutil.ignore_patterns("__pycache__")
    for name in ("bayesdamp", "studies", "validation"):
        shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=left_out)
    made = subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-q", "-w", out, source],
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    return next(out.glob("bayesdamp-*.whl"))


def test_all_is_in_it(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    studies = {f"bayesdamp/studies/{p.name}" for p in (ROOT / "studies").iterdir()}
    assert {"bayesdamp/py.typed", "bayesdamp/report/templates/report.html"} | studies <= names
    modules = {
        str(p.relative_to(ROOT)) for p in (ROOT / "bayesdamp").rglob("*.py") if "__pycache__" not in p.parts
    }
    assert modules <= names
    assert not [n for n in names if n.startswith(("tests", "docs", "reports", "validation"))]


def test_a_shipped_study_is_found_by_name(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path / "installed")
    where = "from bayesdamp.config.load import shipped_folder; print(shipped_folder())"
    for arguments, said in (
        (("-c", where), str(tmp_path / "installed" / "bayesdamp" / "studies")),
        (("-m", "bayesdamp", "check", "quickstart"), "quickstart: ok"),
    ):
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(tmp_path / "installed")},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert said in done.stdout
