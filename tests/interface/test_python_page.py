"""The examples of docs/python.md, in their order, run and pass pyright's strict mode."""

import json
import re
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

from bayesdamp.physics.damping import TERMS

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "python.md"
UNTYPED = re.compile(r"\b(az|emcee|sampler|mcmc|numpyro|study)\b|to_netcdf")
"""Lines that call libraries without types, or build a study from plain dictionaries."""
WRONG = 'print(bd.fit(bd.Model("viscous"), bd.Model("viscous")).value)'

pytestmark = pytest.mark.slow


def examples() -> list[str]:
    """Return the page's Python code; line numbers are those of the page."""
    lines, inside = [], False
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("```"):
            inside = line == "```python"
            line = ""
        lines.append(line if inside else "")
    return lines


def strict(folder: Path, lines: list[str]) -> subprocess.CompletedProcess[str]:
    """Check the types of a script in strict mode."""
    config = {"typeCheckingMode": "strict", "venvPath": str(ROOT), "venv": ".venv", "extraPaths": [str(ROOT)]}
    (folder / "pyrightconfig.json").write_text(json.dumps(config), encoding="utf-8")
    script = "\n".join(f"{x}  # pyright: ignore" if UNTYPED.search(x) else x for x in lines)
    (folder / "page.py").write_text(script, encoding="utf-8")
    pyright = str(Path(sys.executable).with_name("pyright"))
    return subprocess.run([pyright, "-p", str(folder)], capture_output=True, text=True, check=False)


def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mpl.use("agg")
    try:
        exec(compile("\n".join(examples()), str(PAGE), "exec"), {"__name__": "page"})
    finally:
        plt.close("all")
        TERMS.remove("cubic_drag")
    for name in ("rig.html", "small/report.html", "viscous.nc"):
        assert (tmp_path / name).is_file()


def test_the_types_of_the_examples_are_right_in_strict_mode(tmp_path: Path) -> None:
    """Control: a model in the place of a signal, and an attribute that does not exist."""
    right = strict(tmp_path, examples())
    assert right.returncode == 0, right.stdout
    wrong = strict(tmp_path, [*examples(), WRONG])
    assert wrong.returncode == 1
    assert "reportArgumentType" in wrong.stdout
    assert "reportAttributeAccessIssue" in wrong.stdout
