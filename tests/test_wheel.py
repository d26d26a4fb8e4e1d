"""The wheel contains the studies, templates and types that the program needs, and neither tests nor validation."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def run(*arguments: str | Path, folder: Path = ROOT, path: Path = ROOT) -> str:
    """Run Python in a folder with a PYTHONPATH, and return its output."""
    env = os.environ | {"PYTHONPATH": str(path)}
    command = [sys.executable, *arguments]
    process = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    return process.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, source / name)
    left_out = shutil.ignore_patterns("__pycache__")
    for name in ("bayesdamp", "studies", "validation"):
        shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=left_out)
    run("-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-q", "-w", out, source)
    return next(out.glob("bayesdamp-*.whl"))


def test_the_wheel_contains_the_package_and_its_studies(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    studies = {f"bayesdamp/studies/{p.name}" for p in (ROOT / "studies").iterdir()}
    assert {"bayesdamp/py.typed", "bayesdamp/report/templates/report.html"} | studies <= names
    files = (ROOT / "bayesdamp").rglob("*.py")
    assert {str(p.relative_to(ROOT)) for p in files if "__pycache__" not in p.parts} <= names
    assert not [n for n in names if n.startswith(("tests", "docs", "reports", "validation"))]


def test_a_shipped_study_is_loaded_by_its_name(wheel: Path, tmp_path: Path) -> None:
    installed = tmp_path / "installed"
    zipfile.ZipFile(wheel).extractall(installed)
    where = "from bayesdamp.config.load import shipped_folder; print(shipped_folder())"
    assert str(installed / "bayesdamp" / "studies") in run("-c", where, folder=tmp_path, path=installed)
    assert "quickstart: ok" in run("-m", "bayesdamp", "check", "quickstart", folder=tmp_path, path=installed)
